-- Resumes, closes and wraps the scheduler's coroutines.
-- expect: error
-- expect where times do not count: done
local main = coroutine.running()
local waiting
task.spawn(function()
	waiting = coroutine.running()
	task.wait(0.05)
	robot.move(90, 90, 0.01)
end)
task.wait()
for _, co in { main, waiting } do
	pcall(coroutine.resume, co, true, 99)
	pcall(coroutine.close, co)
	pcall(coroutine.status, co)
	task.spawn(function()
		pcall(coroutine.resume, co, true, 99)
		pcall(coroutine.close, co)
	end)
end
local inner = coroutine.wrap(function()
	local own = coroutine.running()
	task.spawn(function()
		pcall(coroutine.resume, own)
		pcall(coroutine.close, own)
	end)
	task.wait(0.02)
	coroutine.yield()
end)
inner()
task.wait(0.1)
pcall(inner)
pcall(inner)
