-- An on_stop that is one library call with callbacks in C.
-- expect: done
script.on_stop(function()
	local list = table.create(200000, 1)
	table.sort(table.create(200000, list), table.find)
end)
