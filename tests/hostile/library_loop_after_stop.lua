-- Stops driving, and then sorts in C forever.
-- expect: cpu
robot.stop()
task.wait(0.1)
local list = table.create(200000, 1)
table.sort(table.create(200000, list), table.find)
