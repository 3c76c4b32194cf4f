-- An iteration in C over tables of tables whose callback is the same function: 2^40 steps.
-- expect: cpu
local tree = {}
for _ = 1, 40 do
	tree = { [tree] = table.foreach, [table.clone(tree)] = table.foreach }
end
table.foreach(tree, table.foreach)
