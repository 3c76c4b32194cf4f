-- wrong: remember the last offset in a variable
robot.on("frame", function(frame)
	local last = 0
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line then
		last = line.offset
		robot.drive(0.12, -1.5 * line.offset)
	else
		robot.drive(0, if last > 0 then -0.6 else 0.6)
	end
end)
