-- A hundred tasks at a time, each inside a library function.
-- expect: cpu
local list = table.create(20000, 1)
for _ = 1, 100 do
	task.spawn(function()
		while true do
			table.sort(table.create(20000, list), table.find)
		end
	end)
end
