-- Endless recursion.
-- expect: error
local function deeper()
	return 1 + deeper()
end
deeper()
