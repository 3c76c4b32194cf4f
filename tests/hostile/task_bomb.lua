-- Tasks that make tasks.
-- expect: error cpu memory
local function split()
	task.spawn(split)
	task.spawn(split)
	task.wait()
end
split()
while true do
	task.spawn(split)
end
