-- 140 percent, in a variable.
-- expect: check 4: robot.move: right must be between -100 and 100, got 140
local FAST = 140
robot.move(50, FAST)
