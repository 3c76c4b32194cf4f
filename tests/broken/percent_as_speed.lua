-- Percent where metres per second are wanted.
-- expect: check 3: robot.drive takes metres per second
robot.drive(20, 0.5, 2)
