-- dock_now: sends the robot to its charging station and reports the result. If the station is not
-- found, the robot drives on over free floor and searches from there. Ends when the robot charges, or
-- with an error if it could not dock.

local floor = require("@spykee/floor")

local DRIVE = 12 -- seconds from one place to the next

local settings = params.declare({
	retries = { default = 2, min = 0, max = 20, doc = "further tries after the first, where it starts" },
	timeout = { default = 120, min = 5, max = 600, unit = "s", doc = "the longest time to search in one try" },
	places = { default = 4, min = 0, max = 50, doc = "further places to search from, if the station is not found" },
})

local docked, code, info
for place = 0, settings.places do
	docked, code, info = robot.dock({ timeout = settings.timeout, retries = if place == 0 then settings.retries else 0 })
	if docked or code ~= "base_not_found" or place == settings.places then
		break
	end
	log.info("the station is not in sight; driving on to search from another place")
	robot.turn(math.rad(math.random(-90, 90)))
	floor.drive_on(DRIVE, 0.2)
end

if docked then
	print(`on the station and charging: {code}, {info.attempts} tries, {math.round(info.seconds)} s`)
	robot.blink("all", { on = 0.1, off = 0.1, count = 2 }):join()
else
	robot.play("alarm")
	error(`could not dock: {code}`)
end
