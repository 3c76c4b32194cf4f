-- watch_post: leaves its station, turns to where the room is, and stands there for a while; then it goes
-- home. On its station the camera faces the wall, so the guard, which runs beside it, sees nobody: from
-- here it sees who comes. A low battery ends the watch early: the watchdog takes the robot home. It
-- needs a robot whose level is a share of the energy, or `watchdog: { power: voltage }` in the config,
-- which `spykee doctor --first` finds out: here it drives too little to see that a voltage sags.

local floor = require("@spykee/floor")

local settings = params.declare({
	minutes = { default = 20, min = 1, max = 240, unit = "min", doc = "how long it watches" },
})

if robot.docked() then
	local out, why = floor.leave_station()
	if not out then
		error(`could not leave the station: {why}`)
	end
end
log.info("watching", { minutes = settings.minutes })
if robot.wait_for("docked", 60 * settings.minutes) then
	log.info("taken home early")
	return
end
local home, code = robot.dock()
if not home then
	log.warn(`not home: {code}`)
end
