-- {{NAME}}: follows something red; looks around while none is in sight. When the battery runs low the
-- watchdog takes it home; once it has charged it leaves its station and continues.
--
-- Try it:  spykee run {{NAME}}.lua --sim
-- Another colour: see `colours:` in spykee.yaml.

local floor = require("@spykee/floor")

local COLOUR = "red"
local NEAR = 125 -- pixels: when it looks this wide, the robot is close enough
local ENOUGH = 60 -- percent: it leaves its station at this battery level

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

local function follow(frame)
	local blob = frame:find_blobs(COLOUR, { pixels_threshold = 25 })[1]
	if not blob then
		robot.drive(0, 0.7) -- metres per second, radians per second
	elseif blob.w < NEAR then
		robot.drive(0.2, 2 * blob.bearing)
	else
		robot.drive(0, 2 * blob.bearing)
	end
end

while true do
	if robot.docked() then
		leave_station()
	end
	local frame = robot.wait_frame(1)
	if frame then
		follow(frame)
	else
		robot.stop() -- blind
	end
end
