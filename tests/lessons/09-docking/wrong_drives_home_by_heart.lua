-- wrong: It does not come home
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.5)
robot.turn(math.rad(180))
robot.forward(0.5)
robot.play(if robot.docked() then "bip_2" else "alarm")
