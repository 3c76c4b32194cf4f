-- dock_now: sends the robot to its charging station and reports the result. If its receivers do not
-- find the station, the robot looks for it with its camera, drives nearer, and searches from there.
-- Ends when the robot charges, or with an error if it could not dock.

local floor = require("@spykee/floor")
local station = require("@spykee/station")

local SEARCH = 60 -- seconds to look for the station from one place on
local ASIDE = 5 -- seconds of driving elsewhere
local SPEED = 0.2 -- m/s
local NEAR = 1.5 -- metres from the station, from where its beacon is received
local ROOM = 0.6 -- metres that must be free ahead
local PATIENCE = 4 -- seconds without a free way to the station in the picture

local settings = params.declare({
	retries = { default = 2, min = 0, max = 20, doc = "further tries after the first, where it starts" },
	timeout = { default = 120, min = 5, max = 600, unit = "s", doc = "the longest time to search in one try" },
	places = { default = 6, min = 0, max = 50, doc = "further places to search from, if it does not find the station" },
})

-- Looks for the station, also from other places, and drives there until it is near. If it was near before,
-- or there is no way to it, drives to another side.
local function drive_nearer()
	floor.search(station.find, { seconds = SEARCH, speed = SPEED })
	local near, drove, arrived = floor.memory(), false, false
	local way_at, over = task.now(), task.now() + SEARCH
	while not arrived and task.now() < math.min(over, way_at + PATIENCE) do
		local frame = robot.wait_frame(1)
		local bearing, away
		if frame then
			bearing, away = station.find(frame)
		end
		arrived = bearing ~= nil and away < NEAR
		if not arrived and bearing and near:look(frame).ahead > ROOM then
			way_at, drove = task.now(), true
			robot.drive(SPEED * math.max(0, 1 - 2 * math.abs(bearing)), bearing)
		else
			robot.stop() -- somebody may walk by
		end
	end
	robot.stop()
	if not (arrived and drove) then
		robot.turn(math.rad(math.random(60, 120)) * (if math.random() < 0.5 then 1 else -1))
		floor.drive_on(ASIDE, SPEED)
	end
end

local docked, code, info
for place = 0, settings.places do
	docked, code, info = robot.dock({ timeout = settings.timeout, retries = if place == 0 then settings.retries else 0 })
	local lost = code == "base_not_found" or code == "timeout"
	if docked or not lost or place == settings.places then
		break
	end
	log.info("the station is not found; driving on to search from another place")
	drive_nearer()
end

if docked then
	print(`on the station and charging: {code}, {info.attempts} tries, {math.round(info.seconds)} s`)
	robot.blink("all", { on = 0.1, off = 0.1, count = 2 }):join()
else
	robot.play("alarm")
	error(`could not dock: {code}`)
end
