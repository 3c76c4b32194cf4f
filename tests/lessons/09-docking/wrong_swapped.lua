-- wrong: It is home, but there was an alarm
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.5)
local ok = robot.dock()
if ok then
	robot.play("alarm")
else
	robot.play("bip_2")
end
