-- A handler that stays in the library: every event is a long search.
-- expect: cpu
local list = table.create(100000, 1)
local every = task.every(0.001, function()
	table.sort(table.create(100000, list), table.find)
end)
every:join()
