-- The upper limit before the lower one.
-- expect: run 4: math.clamp: the lower limit comes first, and must not be above the upper one
local speed = 50
print(math.clamp(speed, 100, 1))
