-- A time or a power where metres are wanted.
-- expect: check 3: robot.forward takes metres
robot.forward(40)
