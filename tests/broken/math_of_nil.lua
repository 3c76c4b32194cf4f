-- A function of math with nothing.
-- expect: run 4: math.floor: `goals.speed` must be a number, but it is nil
local goals = {}
print(math.floor(goals.speed))
