-- wrong: It could not get home, but there was a beep
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.5)
robot.play("bip_2")
task.wait(1)
if not robot.dock() then
	robot.play("alarm")
end
