-- Cancelled tasks that catch the cancellation and continue, waiting or not.
-- expect: cpu done
local function stays()
	while true do
		pcall(task.wait, 1)
		pcall(robot.move, 90, 90)
	end
end
local one, other = task.spawn(stays), task.spawn(stays)
task.wait(0.02)
one:cancel()
other:cancel()
task.wait(0.02)
local function loops()
	pcall(task.wait, 1)
	while true do
		pcall(function() end)
	end
end
local third = task.spawn(loops)
task.wait(0.02)
third:cancel()
