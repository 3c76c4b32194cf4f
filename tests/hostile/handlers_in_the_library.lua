-- Handlers, coroutines and protected calls that are library functions.
-- expect: cpu
local list = table.create(100000, "x")
while true do
	xpcall(error, table.concat, list)
	xpcall(table.concat, table.concat, list, 1)
	pcall(pcall, pcall, pcall, table.sort, table.create(1000, list), table.find)
	local co = coroutine.create(table.foreach)
	coroutine.resume(co, table.create(100000, 1), coroutine.isyieldable)
	for _ in coroutine.wrap(table.foreachi), list, math.abs do
	end
end
