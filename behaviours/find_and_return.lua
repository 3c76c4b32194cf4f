-- find_and_return: looks for a thing of one colour, drives up to it, photographs it and comes home to
-- the station. It looks around, and if it sees nothing it drives on to where there is room and looks
-- around there. Ends on the station, or with an error when it found nothing or did not get home.

local floor = require("@spykee/floor")

local settings = params.declare({
	colour = { default = "red", doc = "what to look for: a name, or one of the config's own colours" },
	width = { default = 82, min = 20, max = 200, unit = "px", doc = "how wide it looks, of 320, when the robot has reached it" },
	places = { default = 20, min = 1, max = 100, doc = "looks around at so many places at most" },
	speed = { default = 0.2, min = 0.05, max = 0.3, unit = "m/s", doc = "of the drive" },
})

local TURNING = 0.7 -- rad/s
local LOST = 1.5 -- seconds out of sight
local HELD = 5 -- seconds without coming nearer
local ROOM = 0.8 -- metres that must be free before the camera

-- The thing and the frame that shows it.
local function see()
	local frame = robot.wait_frame(1)
	return frame and frame:find_blobs(settings.colour, { pixels_threshold = 40, merge = true, margin = 4 })[1], frame
end

-- How wide the thing looks, in pixels of a picture of 320x240, whatever size this one has.
local function width_of(thing, frame)
	return thing.w * 320 / frame.width
end

-- Turns once round until it sees the thing. If it does not, it ends up looking to where there is room.
local function look_around()
	local since, most, way = task.now(), 0, 0
	while task.now() - since < 2 * math.pi / TURNING do
		robot.drive(0, TURNING)
		local thing, frame = see()
		if thing then
			return true
		end
		-- By lot, too: otherwise it would take the same way for ever.
		local room = if frame then floor.look(frame).ahead * (0.5 + math.random()) else 0
		if room > most then
			most, way = room, TURNING * (task.now() - since)
		end
	end
	robot.turn(if way > math.pi then way - 2 * math.pi else way)
	return false
end

-- Something held it: back, and a little to the side.
local function evade()
	log.info("something holds me: I go round it")
	robot.forward(-0.4)
	robot.turn(math.rad(math.random(50, 80)) * (if math.random() < 0.5 then 1 else -1))
	robot.forward(0.4)
end

-- Towards the thing; what stands in the way before it is passed on the side where there is more room.
local function steer(thing, frame)
	local free = floor.look(frame)
	if free.ahead < ROOM and width_of(thing, frame) < settings.width / 2 then
		robot.drive(0.7 * settings.speed, if free.left > free.right then 0.6 else -0.6)
	else
		robot.drive(settings.speed * math.max(0, 1 - 2 * math.abs(thing.bearing)), 1.5 * thing.bearing)
	end
end

-- Drives up to it; false when it is lost on the way, or something holds the robot.
local function approach()
	local seen_at, nearer_at, widest = task.now(), task.now(), 0
	while task.now() - seen_at < LOST do
		local thing, frame = see()
		if thing then
			seen_at = task.now()
			local width = width_of(thing, frame)
			if width > widest then
				widest, nearer_at = width, seen_at
			end
			if width >= settings.width then
				robot.stop()
				return true
			elseif seen_at - nearer_at > HELD then
				evade()
				return false
			end
			steer(thing, frame)
		end
	end
	robot.stop()
	return false
end

local function find()
	for place = 1, settings.places do
		log.info(`looking around, place {place}`)
		if look_around() and approach() then
			return true
		end
		floor.drive_on(math.random(6, 12), settings.speed, see)
	end
	log.warn(`there is nothing {settings.colour} far and wide`)
	return false
end

local function celebrate()
	local frame = robot.wait_frame(2)
	log.info(`found {settings.colour}`, { picture = frame and frame:save(`{settings.colour}.jpg`) or "none" })
	robot.play("laugh")
	robot.blink("all", { on = 0.2, off = 0.2, count = 3 }):join()
end

-- The station shines only so far: where its light is not seen the robot goes on and tries again. A search turns
-- the robot by the same angle each time: without a turn by lot it would go to and fro between two places.
local function come_home()
	local home, code
	for place = 1, settings.places do
		log.info("going home")
		home, code = robot.dock({ retries = 0 })
		if home or code ~= "base_not_found" then
			break
		end
		if place > 1 then
			robot.turn(math.rad(math.random(-150, 150)))
		end
		floor.drive_on(10, settings.speed)
	end
	assert(home, `could not dock: {code}`)
end

robot.undock()
local found = find()
if found then
	celebrate()
end
come_home()
assert(found, `found nothing {settings.colour}`)
