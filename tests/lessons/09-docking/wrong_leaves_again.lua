-- wrong: It was home, but did not stay there|The script does not end
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.5)
local ok = robot.dock()
robot.play(if ok then "bip_2" else "alarm")
task.wait(2)
floor.leave_station()
