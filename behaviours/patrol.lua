-- patrol: drives a beat of legs; at the end of each leg it looks around, photographs what it sees
-- and tells which colours are there. When the battery runs low it goes home, charges, leaves the
-- station and takes up the beat where it left it. Runs until it is ended.
--
-- LEG: metres of one leg. SPEED: m/s. LEGS: legs of a beat, a turn of a full circle between them.
-- GO_HOME: at this battery level, in percent, it docks by itself (the watchdog does it at 20 %,
-- whatever this script does). ENOUGH: at this level it goes out again.

local LEG = 0.9
local SPEED = 0.3
local LEGS = 4
local GO_HOME = 30
local ENOUGH = 75
local COLOURS = { "red", "green", "blue", "yellow" }

local leg = 0
local rounds = 0

local function level()
	local battery = robot.battery()
	return if battery then battery.percent else 0
end

local function colours_in(frame)
	local seen = {}
	for _, blob in frame:find_blobs(COLOURS, { pixels_threshold = 60 }) do
		seen[blob.colour] = true
	end
	local names = {}
	for _, colour in COLOURS do
		if seen[colour] then
			table.insert(names, colour)
		end
	end
	return if #names > 0 then table.concat(names, ", ") else "nothing bright"
end

local function photograph(name)
	local frame = robot.wait_frame(2)
	if not frame then
		return log.warn("no picture: the camera is silent")
	end
	robot.led("flash", true)
	robot.play("snapshot")
	local path, why = frame:save(name)
	robot.led("flash", false)
	log.info(`I see {colours_in(frame)}`, { picture = path or why })
end

local LOOKS = {
	{ name = "left", angle = math.pi / 4 },
	{ name = "right", angle = -math.pi / 2 },
	{ name = "ahead", angle = math.pi / 4 },
}

local function look_around()
	for _, look in LOOKS do
		if not robot.turn(look.angle) then
			return
		end
		photograph(`round{rounds}-leg{leg}-{look.name}.jpg`)
	end
end

local function charge()
	log.info(`charging, the battery is at {level()} %`)
	while level() < ENOUGH do
		robot.wait_for("battery", 30)
	end
end

-- True when the robot is off its station and may drive again.
local function go_home()
	log.info(`going home, the battery is at {level()} %`)
	local docked, code = robot.dock({ timeout = 120, retries = 3 })
	if not docked then
		log.warn(`could not dock: {code}`)
		task.wait(5)
		return
	end
	charge()
	local out, why = robot.undock()
	if not out then
		log.warn(`could not leave the station: {why}`)
		return task.wait(5)
	end
	-- It has backed out and looks at its station.
	robot.turn(math.pi)
end

local function patrol()
	leg = leg % LEGS + 1
	rounds += if leg == 1 then 1 else 0
	log.info(`round {rounds}, leg {leg}`)
	local done, code = robot.forward(LEG, SPEED)
	if not done then
		log.info(`leg {leg} was cut short: {code}`)
		task.wait(1)
		return
	end
	look_around()
	robot.turn(2 * math.pi / LEGS)
end

while true do
	if robot.docked() or level() <= GO_HOME then
		go_home()
	else
		patrol()
	end
end
