-- dock_now: sends the robot to its charging station and tells how it went. Ends when the robot
-- charges, or with an error when it could not get home.
--
-- RETRIES: tries after the first one. TIMEOUT: the longest search of one try, in seconds.

local RETRIES = 2
local TIMEOUT = 120

local docked, code, info = robot.dock({ timeout = TIMEOUT, retries = RETRIES })
if docked then
	print(`on the station and charging: {code}, {info.attempts} tries, {math.round(info.seconds)} s`)
	robot.blink("all", { on = 0.1, off = 0.1, count = 2 }):join()
else
	robot.play("alarm")
	error(`could not dock: {code}`)
end
