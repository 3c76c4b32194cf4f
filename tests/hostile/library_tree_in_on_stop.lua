-- An on_stop that walks a tree in C forever.
-- expect: done
script.on_stop(function()
	local tree = {}
	for _ = 1, 40 do
		tree = { [tree] = table.foreach, [table.clone(tree)] = table.foreach }
	end
	table.foreach(tree, table.foreach)
end)
