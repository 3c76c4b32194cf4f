-- `__eq` in C, called by a search in C, which is that `__eq`: ten to the power of twenty steps.
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
