-- Leaves its station and wanders, over free floor.
local floor = require("@spykee/floor")

robot.undock()
robot.turn(math.pi)
while true do
	floor.drive_on(math.random(4, 12), 0.3)
	robot.turn(math.rad(math.random(-60, 60)))
	task.wait(0.1)
end
