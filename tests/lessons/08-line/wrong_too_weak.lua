-- wrong: It does not get round the first bend|It has lost the line at bend|When the line is lost it stands still
local last = 0
robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line then
		last = line.offset
		robot.drive(0.2, -0.1 * last)
	else
		robot.drive(0.2, -0.1 * last)
	end
end)
