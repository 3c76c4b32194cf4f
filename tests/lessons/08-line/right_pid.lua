-- right
local pid = require("@spykee/pid")
local steer = pid.new({ kp = 1.4, kd = 0.1 })
local side = 1

robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line then
		side = if line.offset > 0 then -1 else 1
		robot.drive(0.1, steer:update(line.offset))
	else
		robot.drive(0, 0.5 * side)
	end
end)
