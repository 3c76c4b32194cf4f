-- A walk in C over tables of tables that is itself the callback: two to the power of forty steps.
-- expect: cpu
local tree = {}
for _ = 1, 40 do
	tree = { [tree] = table.foreach, [table.clone(tree)] = table.foreach }
end
table.foreach(tree, table.foreach)
