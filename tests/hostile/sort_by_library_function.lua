-- A comparator in C that makes a long search in C: no script code runs in between.
-- expect: cpu
local list = table.create(200000, 1)
while true do
	pcall(table.sort, table.create(200000, list), table.find)
end
