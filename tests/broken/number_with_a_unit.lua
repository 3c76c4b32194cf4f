-- A number with a unit.
-- expect: check 4: this is not a number
-- help: a number has no unit; in metres, this is 0.5
local far = 50cm
print(far)
