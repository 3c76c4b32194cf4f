-- A number in a line of its own.
-- expect: check 5: `5` alone does nothing
-- help: a line begins with a name
local side = 1
5
print(side)
