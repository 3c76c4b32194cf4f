-- Milliseconds for the time of a motion.
-- expect: check 4: robot.move takes seconds: 800 are 13 minutes
-- help: for milliseconds, write 0.8
robot.move(35, 35, 800)
