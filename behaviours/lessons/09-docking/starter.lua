-- spykee lesson 9: going home
-- Leaves the station, drives half a metre, goes home, and reports the result.
-- Here it beeps whatever happened. When it could not get home it should sound the alarm.

local floor = require("@spykee/floor")

floor.leave_station()
robot.forward(0.5)
robot.dock()
robot.play("bip_2")
