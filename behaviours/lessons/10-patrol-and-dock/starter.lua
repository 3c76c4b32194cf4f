-- spykee lesson 10: patrol and dock
-- A patrol for the whole day: three legs with a photograph each, home, charge to 60 %, repeat.
-- Here it drives one leg and goes home.

local floor = require("@spykee/floor")

floor.leave_station()
robot.forward(0.4)
robot.dock()
