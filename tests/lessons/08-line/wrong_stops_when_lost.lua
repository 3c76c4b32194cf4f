-- wrong: When the line is lost it stands still
robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line then
		robot.drive(0.12, -1.5 * line.offset)
	else
		robot.stop()
	end
end)
