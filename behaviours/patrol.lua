-- patrol: drives round after round, each of several legs. At the end of each leg it looks around,
-- takes photographs, in the dark with its headlight, and logs the colours that it sees. Once in each
-- round, after another leg each time, it stands still for a while: a guard beside it sees nobody while
-- the robot moves. When the battery runs low it goes home, charges, leaves the station and continues
-- with the leg that it had not finished; after a restart it does the same. Runs until it is stopped;
-- with `rounds` it goes home after so many rounds, sends one message that sums them up when it is
-- there, and ends.

local floor = require("@spykee/floor")

local settings = params.declare({
	leg = { default = 0.9, min = 0.1, max = 10, unit = "m", doc = "length of one leg" },
	legs = { default = 4, min = 1, max = 12, doc = "legs of a round; the turns between them add up to a full circle" },
	speed = { default = 0.3, min = 0.05, max = 0.45, unit = "m/s", doc = "speed on a leg" },
	watch = { default = 10, min = 0, max = 600, unit = "s", doc = "stands still so long once in a round, so that a guard sees who moves" },
	go_home = { default = 40, min = 31, max = 90, unit = "%", doc = "docks at this battery level; at 30 % the watchdog docks" },
	enough = { default = 75, min = 35, max = 100, unit = "%", doc = "leaves the station at this battery level" },
	rounds = { default = 0, min = 0, max = 1000, doc = "rounds until it goes home and ends; 0: goes on until it is stopped" },
})
local COLOURS = { "red", "green", "blue", "yellow" }
local DARK = 0.25 -- a picture darker than this is night, as for night_light
local LIT = 0.5 -- seconds until pictures show the light that was switched on

local leg = store.get("leg", 1) -- the next leg to drive
local round = store.get("round", 1)
-- The tour of `rounds`; one that was cut short goes on at the next start.
local began = clock.now()
local tour = { round = round, seconds = 0, pictures = 0 }
if settings.rounds > 0 then
	tour = store.get("tour", tour)
else
	store.delete("tour")
end
local earlier = tour.seconds -- what earlier starts have driven of it

local function level()
	local battery = robot.battery()
	return if battery then battery.percent else 0 -- nil: not known
end

local function shown_level()
	return if level() then `{level()} %` else "an unknown level"
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

-- Returns the next picture; in the dark the first one that shows what the headlight shines on.
local function lit_frame()
	local frame = robot.wait_frame(2)
	robot.led("flash", true)
	if frame and frame:brightness() < DARK then
		task.wait(LIT)
		return robot.wait_frame(2)
	end
	return frame
end

local function photograph(name)
	local frame = lit_frame()
	local path, why
	if frame then
		robot.play("snapshot")
		path, why = frame:save(`{string.sub(clock.date().text, 1, 10)}-{name}`)
	end
	robot.led("flash", false)
	if not frame then
		return log.warn("the camera sent no picture")
	end
	tour.pictures += if path then 1 else 0
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
		photograph(`round{round}-leg{leg}-{look.name}.jpg`)
	end
	robot.stream("video", false) -- until the next look
end

local function is_over()
	return settings.rounds > 0 and round - tour.round >= settings.rounds
end

local function sum_up()
	local minutes = math.ceil((earlier + clock.now() - began) / 60)
	local text = `patrol: rounds: {round - tour.round}, minutes: {minutes}, pictures: {tour.pictures}; `
		.. `at home, the battery is at {shown_level()}`
	log.info(text)
	notify.send(text)
	store.delete("tour")
end

-- Stores the next leg at once, so that a restart continues there.
local function next_leg()
	leg = leg % settings.legs + 1
	round += if leg == 1 then 1 else 0
	store.set("leg", leg)
	store.set("round", round)
	tour.seconds = earlier + clock.now() - began
	if settings.rounds > 0 then
		store.set("tour", tour)
	end
end

local function patrol()
	log.info(`round {round}, leg {leg}`)
	local done, code = robot.forward(settings.leg, settings.speed)
	if not done then
		log.info(`leg {leg} was cut short: {code}`)
		return task.wait(1)
	end
	look_around()
	robot.turn(2 * math.pi / settings.legs)
	local watches = leg == (round - 1) % settings.legs + 1
	next_leg()
	if watches then
		task.wait(settings.watch) -- after the turn: for a guard, the headlight that goes off is something that moves
	end
end

local function charge()
	log.info(`charging, the battery is at {shown_level()}`)
	while (level() or 100) < settings.enough do
		robot.wait_for("battery", 30)
	end
end

local function go_home()
	if not robot.docked() then
		log.info(`going home, the battery is at {shown_level()}`)
	end
	local docked, code = robot.dock({ timeout = 120, retries = 0 })
	if code == "base_not_found" then
		-- Without the station's beacon, more searches from the same place would fail too.
		robot.turn(math.rad(math.random(-180, 180)))
		return floor.drive_on(6, settings.speed)
	elseif not docked then
		log.warn(`could not dock: {code}`)
		return task.wait(5)
	end
	if is_over() then
		return
	end
	charge()
	local out, why = floor.leave_station()
	robot.stream("video", false)
	if not out then
		log.warn(`could not leave the station: {why}`)
		-- If its level is not known, the watchdog knows when it has charged enough.
		task.wait(if level() then 5 else 300)
	end
end

while not (is_over() and robot.docked()) do
	if robot.docked() or is_over() or (level() or 100) <= settings.go_home then
		go_home()
	else
		patrol()
	end
end

sum_up()
