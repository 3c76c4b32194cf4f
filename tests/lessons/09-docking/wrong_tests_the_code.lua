-- wrong: It could not get home, but there was a beep
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.5)
local ok, code = robot.dock()
if code then
	robot.play("bip_2")
else
	robot.play("alarm")
end
