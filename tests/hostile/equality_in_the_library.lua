-- A search in C calls `__eq`, which is a library function that searches too: 10^20 steps.
-- expect: cpu
local meta = { __eq = table.find }
local function tree()
	local node = setmetatable({}, meta)
	for _ = 1, 20 do
		node = setmetatable(table.create(10, node), meta)
	end
	return node
end
local one, other = tree(), tree()
while true do
	pcall(table.find, one, other)
	pcall(function()
		return one == other
	end)
end
