-- Recursion that carries all its arguments along.
-- expect: error memory cpu
local function grow(...)
	return grow(1, ...), 1
end
grow()
