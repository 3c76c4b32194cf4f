-- Leaves its station, drives, and comes back.
assert(robot.undock())
assert(robot.turn(math.rad(120)))
assert(robot.forward(0.3))
assert(robot.dock())
