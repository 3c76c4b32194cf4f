-- spykee lesson 9: going home
-- Leaves the station, drives half a metre, goes home, and reports the result.

local floor = require("@spykee/floor")

floor.leave_station()
robot.forward(0.5)
local ok, code = robot.dock()
print("docking:", code)
if ok then
	robot.play("bip_2")
else
	robot.play("alarm")
end
