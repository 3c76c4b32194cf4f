-- Nested pcalls, which catch every end that is raised only once in a while.
-- expect: cpu
local function again()
	pcall(again)
	while true do
		pcall(again)
	end
end
again()
