-- An iteration in C with a slow callback in C.
-- expect: cpu
local list = table.create(100000, "x")
local function walk()
	table.foreachi(table.create(100000, list), function() end)
	table.foreachi(table.create(100000, " "), string.rep)
	table.foreach(table.create(100000, list), table.create)
end
while true do
	pcall(walk)
end
