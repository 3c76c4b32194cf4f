-- A function of the robot cannot be set.
-- expect: check 3: robot.move cannot be set
robot.move = 50
