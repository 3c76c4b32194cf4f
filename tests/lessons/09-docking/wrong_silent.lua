-- wrong: It is home, but there was no beep
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.5)
local ok, code = robot.dock()
print(ok, code)
