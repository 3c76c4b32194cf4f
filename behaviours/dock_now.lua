-- dock_now: sends the robot to its charging station and reports the result. If its receivers do not
-- find the station, the robot looks for it with its camera, drives nearer, and searches from there.
-- Ends when the robot charges, or with an error if it could not dock.

local station = require("@spykee/station")

local settings = params.declare({
	retries = { default = 2, min = 0, max = 20, doc = "further tries after the first, where it starts" },
	timeout = { default = 120, min = 5, max = 600, unit = "s", doc = "the longest time to search in one try" },
	places = { default = 6, min = 0, max = 50, doc = "further places to search from, if it does not find the station" },
})

local docked, code, info
for place = 0, settings.places do
	docked, code, info = robot.dock({ timeout = settings.timeout, retries = if place == 0 then settings.retries else 0 })
	local lost = code == "base_not_found" or code == "timeout"
	if docked or not lost or place == settings.places then
		break
	end
	log.info("the station is not found; driving on to search from another place")
	station.drive_nearer()
end

if docked then
	print(`on the station and charging: {code}, {info.attempts} tries, {math.round(info.seconds)} s`)
	robot.blink("all", { on = 0.1, off = 0.1, count = 2 }):join()
else
	robot.play("alarm")
	error(`could not dock: {code}`)
end
