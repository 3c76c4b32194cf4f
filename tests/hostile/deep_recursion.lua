-- Recursion without end.
-- expect: error
local function deeper()
	return 1 + deeper()
end
deeper()
