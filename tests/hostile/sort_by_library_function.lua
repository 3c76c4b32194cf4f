-- A comparator in C, and in it a long search in C: no line of a script runs in between.
-- expect: cpu
local list = table.create(200000, 1)
while true do
	pcall(table.sort, table.create(200000, list), table.find)
end
