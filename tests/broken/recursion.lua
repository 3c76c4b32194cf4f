-- A function that calls itself without end.
-- expect: run 4: a function calls itself endlessly
local function patrol()
	return 1 + patrol()
end
print(patrol())
