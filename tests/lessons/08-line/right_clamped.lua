-- right
local offset = 0
robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line ~= nil then
		offset = line.offset
		robot.drive(0.1, math.clamp(-1.5 * offset, -1.4, 1.4))
	else
		robot.drive(0, -0.6 * math.sign(offset))
	end
end)
