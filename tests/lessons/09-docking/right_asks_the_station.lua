-- right
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.5)
robot.dock()
if robot.docked() then
	robot.play("bip_2")
end
if not robot.docked() then
	robot.play("alarm")
end
