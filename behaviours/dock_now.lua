-- dock_now: sends the robot to its charging station and reports the result. Ends when the robot
-- charges, or with an error if it could not dock.

local settings = params.declare({
	retries = { default = 2, min = 0, max = 20, doc = "further tries after the first" },
	timeout = { default = 120, min = 5, max = 600, unit = "s", doc = "the longest time to search in one try" },
})

local docked, code, info = robot.dock({ timeout = settings.timeout, retries = settings.retries })
if docked then
	print(`on the station and charging: {code}, {info.attempts} tries, {math.round(info.seconds)} s`)
	robot.blink("all", { on = 0.1, off = 0.1, count = 2 }):join()
else
	robot.play("alarm")
	error(`could not dock: {code}`)
end
