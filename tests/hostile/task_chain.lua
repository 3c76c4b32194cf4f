-- A task that starts the next one and ends: each slice is short, and none waits.
-- expect: done
local made = 0
local function next_one()
	made += 1
	task.spawn(next_one)
end
next_one()
task.wait(0.2)
script.stop("enough")
