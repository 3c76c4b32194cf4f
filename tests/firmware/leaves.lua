-- Leaves its station, drives, and comes back. Waits only if the robot does not tell its level.
local battery = robot.battery()
if battery and not battery.percent and not robot.undock() then
	log.info("charges first")
	while robot.docked() and not robot.undock() do
		task.wait(60)
	end
end
assert(not robot.docked() or robot.undock())
assert(robot.turn(math.rad(120)))
assert(robot.forward(0.3))
assert(robot.dock())
