-- Leaves its station, drives, and comes back.
assert(robot.undock())
task.wait(6) -- where POWER comes late, an old one says that it charges
assert(robot.turn(math.rad(120)))
assert(robot.forward(0.3))
assert(robot.dock())
