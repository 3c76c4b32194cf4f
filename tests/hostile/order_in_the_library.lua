-- `__lt`, `__index` and `__len` in C, called by sorting and by unpacking.
-- expect: cpu
local long = table.create(100000, 1)
local meta = { __lt = rawequal, __index = table.find, __len = table.maxn }
local list = {}
for at = 1, 2000 do
	list[at] = setmetatable({}, meta)
end
while true do
	pcall(table.sort, list)
	pcall(table.sort, list, rawequal)
	pcall(table.sort, table.create(50000, long), table.concat)
end
