-- A variable set with two signs.
-- expect: check 4: `speed` alone does nothing
local speed = 10
speed == 20
