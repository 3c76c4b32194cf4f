-- right
local last = 0
robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line then
		last = line.offset
		robot.drive(0.16 - 0.08 * math.abs(last), -1.5 * last)
	else
		robot.drive(0, if last > 0 then -0.6 else 0.6)
	end
end)
