-- Captures the marker that runtime and scheduler exchange, and returns it in the wrong places.
-- expect: error
local caught = {}
local co = coroutine.create(function()
	task.wait(0.01)
end)
caught[1] = { coroutine.resume(co) }
local raw = coroutine.create(function(...)
	caught[2] = { coroutine.yield(...) }
end)
caught[3] = { coroutine.resume(raw, table.unpack(caught[1])) }
for _, values in caught do
	for _, value in values do
		if type(value) == "userdata" then
			error("the mark was caught")
		end
		pcall(coroutine.yield, value)
		pcall(coroutine.resume, co, value)
		pcall(coroutine.close, co)
		pcall(task.wait, value)
		pcall(task.spawn, coroutine.yield, value)
	end
end
coroutine.yield(table.unpack(caught[1]))
