-- robot is called with a dot.
-- expect: check 3: robot.move must be called with a dot, not with a colon
robot:move(50, 50)
