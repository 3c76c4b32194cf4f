-- {{NAME}}: drives a square, again and again, and blinks at each corner. When the battery runs low the
-- watchdog takes it home; once it has charged it leaves its station and continues.
--
-- Try it:  spykee run {{NAME}}.lua --sim

local floor = require("@spykee/floor")

local SIDE = 0.6 -- metres
local SPEED = 0.25 -- metres per second
local ENOUGH = 60 -- percent: it leaves its station at this battery level

robot.on("battery_low", function(battery)
	log.warn(`{battery.percent or "?"} % left: the watchdog takes me home`)
end)

local function has_enough()
	local battery = robot.battery()
	return battery and (battery.percent or 100) >= ENOUGH -- nil: not known
end

-- On its station it cannot drive: it charges, leaves the station and turns away from it.
local function leave_station()
	while not has_enough() do
		robot.wait_for("battery", 60)
	end
	local _, why = floor.leave_station()
	if why == "safety" then
		robot.wait_for("battery", 60) -- the watchdog wants it to charge longer
	end
end

while true do
	if robot.docked() then
		leave_station()
	end
	local ok, code = robot.forward(SIDE, SPEED)
	if ok then
		robot.blink("all", { count = 1 })
		robot.turn(math.pi / 2) -- radians, to the left
	else
		log.info(`did not get to the corner: {code}`)
		robot.wait_for("docked", 30) -- the watchdog drives
	end
end
