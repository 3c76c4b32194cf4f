-- wrong: the second number of robot.drive must be negative
robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line then
		robot.drive(0.12, 1.5 * line.offset)
	end
end)
