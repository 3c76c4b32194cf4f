-- right
local floor = require("@spykee/floor")
floor.leave_station()
robot.forward(0.5)
local ok = false
local try = 1
while not ok and try <= 2 do
	ok = robot.dock({ timeout = 60, retries = 0 })
	try += 1
end
robot.play(if ok then "bip_2" else "alarm")
