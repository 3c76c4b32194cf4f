-- One track is not enough.
-- expect: check 3: robot.move: right is missing
robot.move(50)
