-- 140 percent.
-- expect: check 3: robot.move: left must be between -100 and 100, got 140
robot.move(140, 100)
