-- Leaves its station as soon as it may, drives, and comes back.
while not robot.undock() do
	task.wait(60)
end
assert(robot.turn(math.rad(120)))
assert(robot.forward(0.3))
assert(robot.dock())
