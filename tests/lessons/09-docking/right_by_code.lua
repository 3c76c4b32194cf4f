-- right
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.5)
local _, code = robot.dock()
local sounds = { done = "bip_2", already_docked = "bip_2" }
robot.play(sounds[code] or "alarm")
