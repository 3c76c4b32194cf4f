-- Waits inside comparators, gsub functions and metamethods.
-- expect: error
pcall(table.sort, { 3, 2, 1 }, function()
	task.wait(9)
	return true
end)
pcall(string.gsub, "abc", "%w", function()
	robot.move(90, 90, 9)
end)
pcall(function()
	return setmetatable({}, { __index = task.wait })[9]
end)
pcall(function()
	for _ in setmetatable({}, { __iter = coroutine.yield }) do
	end
end)
table.sort({ 3, 2, 1 }, coroutine.wrap(function()
	while true do
		coroutine.yield(task.wait(9))
	end
end))
