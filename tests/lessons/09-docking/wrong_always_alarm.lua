-- wrong: It is home, but there was an alarm
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.5)
robot.dock()
robot.play("alarm")
