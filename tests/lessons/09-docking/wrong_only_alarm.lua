-- wrong: It is home, but there was no beep
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.5)
local ok = robot.dock()
if not ok then
	robot.play("alarm")
end
