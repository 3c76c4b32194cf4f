-- A sum that is not kept.
-- expect: check 5: `side` alone does nothing
-- help: keep the result: local result = side + 1
local side = 1
side + 1
print(side)
