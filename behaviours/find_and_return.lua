-- find_and_return: looks for a thing of one colour, drives up to it, photographs it and comes home to
-- the station. It looks around, and if it sees nothing it drives on to where there is room and looks
-- around there. Ends on the station, or with an error when it found nothing or did not get home.

local floor = require("./lib/floor")

local settings = params.declare({
	colour = { default = "red", doc = "what to look for: a name, or one of the config's own colours" },
	width = { default = 60, min = 20, max = 200, unit = "px", doc = "how wide it looks when the robot has reached it" },
	places = { default = 12, min = 1, max = 100, doc = "looks around at so many places at most" },
	speed = { default = 0.2, min = 0.05, max = 0.3, unit = "m/s", doc = "of the drive" },
})

local TURNING = 0.7 -- rad/s
local LOST = 1.5 -- seconds out of sight
local HELD = 5 -- seconds without coming nearer

local function see()
	local frame = robot.wait_frame(1)
	return frame and frame:find_blobs(settings.colour, { pixels_threshold = 40, merge = true, margin = 4 })[1], frame
end

-- Turns once round until it sees the thing.
local function look_around()
	local since = task.now()
	while task.now() - since < 2 * math.pi / TURNING do
		robot.drive(0, TURNING)
		if see() then
			return true
		end
	end
	robot.stop()
	return false
end

-- Drives on to where there is room, for some seconds.
local function move_on()
	local away = if math.random() < 0.5 then 1 else -1
	local until_then = task.now() + math.random(8, 14)
	while task.now() < until_then do
		local frame = robot.wait_frame(1)
		local free = frame and floor.look(frame)
		if free and free.ahead > 0.7 then
			robot.drive(settings.speed, 0.6 * free.turn)
		else
			robot.drive(0, TURNING * away)
		end
		if see() then
			break
		end
	end
	robot.stop()
end

-- Drives up to it; false when it is lost on the way, or comes no nearer because something holds the
-- robot.
local function approach()
	local seen_at, nearer_at, widest = task.now(), task.now(), 0
	while task.now() - seen_at < LOST and task.now() - nearer_at < HELD do
		local thing = see()
		if thing then
			seen_at = task.now()
			if thing.w > widest then
				widest, nearer_at = thing.w, seen_at
			end
			if thing.w >= settings.width then
				robot.stop()
				return true
			end
			robot.drive(settings.speed * math.max(0, 1 - 2 * math.abs(thing.bearing)), 1.5 * thing.bearing)
		end
	end
	robot.forward(-0.3)
	return false
end

local function find()
	for place = 1, settings.places do
		log.info(`looking around, place {place}`)
		if look_around() and approach() then
			return true
		end
		move_on()
	end
	return false
end

local function celebrate()
	local frame = robot.wait_frame(2)
	log.info(`found {settings.colour}`, { picture = frame and frame:save(`{settings.colour}.jpg`) or "none" })
	robot.play("laugh")
	robot.blink("all", { on = 0.2, off = 0.2, count = 3 }):join()
end

-- The station shines only so far: where its light is not seen the robot goes on and tries again.
local function come_home()
	local home, code
	for _ = 1, settings.places do
		log.info("going home")
		home, code = robot.dock({ retries = 0 })
		if home or code ~= "base_not_found" then
			break
		end
		move_on()
	end
	assert(home, `could not dock: {code}`)
end

robot.undock()
local found = find()
if found then
	celebrate()
end
come_home()
assert(found, `there is nothing {settings.colour} far and wide`)
