-- wrong: does not drive half a metre away
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.1)
local ok = robot.dock()
robot.play(if ok then "bip_2" else "alarm")
