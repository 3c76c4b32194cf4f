-- wrong: It does not get round the first bend
robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line then
		robot.drive(0.12, 0)
	else
		robot.stop()
	end
end)
