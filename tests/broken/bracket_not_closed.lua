-- A bracket without its other half.
-- expect: check 3: this '(' is never closed
local half = math.floor((7 + 2) / 2
print(half)
