-- find_and_return: looks for a thing of one colour, drives up to it, photographs it and comes home to
-- the station. It looks around, and if it sees nothing it drives on to where there is room and looks
-- around there. It remembers its way and goes back along it to where it finds the station. Ends on the
-- station, or with an error when it found nothing or did not get home.

local floor = require("@spykee/floor")
local station = require("@spykee/station")
local whereabouts = require("@spykee/whereabouts")

local settings = params.declare({
	colour = { default = "red", doc = "what to look for: a name, or one of the config's own colours" },
	width = { default = 82, min = 20, max = 200, unit = "px", doc = "how wide it looks, of 320, when the robot has reached it" },
	places = { default = 20, min = 1, max = 100, doc = "looks around at so many places at most" },
	speed = { default = 0.27, min = 0.05, max = 0.3, unit = "m/s", doc = "of the drive" },
})

local TURNING = 1.0 -- rad/s
local LOST = 1.5 -- seconds out of sight
local HELD = 5 -- seconds without coming nearer
local ROOM = 0.8 -- metres that must be free before the camera
local BEGINNING, NEARLY = { x = 0, y = 0 }, 3 -- where its way begins, and metres from there that are nearly there
local STEP, REACHED = 0.3, 0.35 -- metres between two places of its way, and to one that it has come back to
local HERE = 2 -- metres from where it began, or from its station, that need no way back
local BESIDE = { math.rad(20), math.rad(40) } -- what is beside a view, from it
local REACH, NEW = 2, 1.5 -- metres ahead at which a way is judged; so far from where it has been is new
local STANDS = 1.5 -- seconds of driving without a change of the picture
local HELDS = 4 -- times that something may hold it on its way back
local LEG = 8 -- seconds of driving from one search of the station to the next
local SLOWEST = 10 -- seconds from one place of its way to the next
local WAITS = 3 -- seconds for whoever stands in its way back

local way = {} -- where it has been: metres, as robot.pose() tells

local function distance(place, pose)
	return math.sqrt((place.x - pose.x) ^ 2 + (place.y - pose.y) ^ 2)
end

local function remember_the_way()
	local pose = robot.pose()
	if #way == 0 or distance(way[#way], pose) > STEP then
		table.insert(way, { x = pose.x, y = pose.y })
	end
end

-- The thing and the frame that shows it.
local function see()
	local frame = robot.wait_frame(1)
	remember_the_way()
	return frame and frame:find_blobs(settings.colour, { pixels_threshold = 40, merge = true, margin = 4 })[1], frame
end

-- How wide the thing looks, in pixels of a picture of 320x240, whatever size this one has.
local function width_of(thing, frame)
	return thing.w * 320 / frame.width
end

-- How new a place is: metres to the nearest one where it has been.
local function newness(place)
	local new = NEW
	for _, been in way do
		new = math.min(new, distance(been, place))
	end
	return new
end

-- How far it is free beside a view, in the mean of both sides.
local function beside(views, heading)
	local sum, count = 0, 0
	for _, view in views do
		local off = math.abs(whereabouts.wrap(view.heading - heading))
		if off > BESIDE[1] and off < BESIDE[2] then
			sum, count = sum + view.ahead, count + 1
		end
	end
	return if count > 0 then sum / count else 1
end

-- The heading that promises most: far, through a gap, and to where it has not been. At random, too: otherwise it
-- would take the same way again and again.
local function most_promising(views)
	local pose, most, best = robot.pose(), 0, nil
	for _, view in views do
		local far = math.min(view.ahead, REACH)
		local there = { x = pose.x + far * math.cos(view.heading), y = pose.y + far * math.sin(view.heading) }
		local gap = view.ahead / (0.5 + beside(views, view.heading))
		local promise = view.ahead * gap * (0.4 + newness(there) / NEW) * (0.5 + math.random())
		if promise > most then
			most, best = promise, view.heading
		end
	end
	return best
end

local side = 1 -- to which it turns: each time the other, so that what it misjudges of its turns adds up to nothing

-- Turns once round until it sees the thing. If it does not, it ends up looking to where it is worth going.
local function look_around()
	local since, views = task.now(), {}
	side = -side
	while task.now() - since < 2 * math.pi / TURNING do
		robot.drive(0, side * TURNING)
		local thing, frame = see()
		if thing then
			return true
		end
		if frame then
			table.insert(views, { heading = robot.pose().heading, ahead = floor.look(frame).ahead })
		end
	end
	local best = most_promising(views)
	if best then
		robot.turn(whereabouts.wrap(best - robot.pose().heading))
	end
	return false
end

-- Something held it: back, and a little to the side.
local function evade()
	log.info("something holds me: I go round it")
	robot.forward(-0.4)
	robot.turn(math.rad(math.random(50, 80)) * (if math.random() < 0.5 then 1 else -1))
	robot.forward(0.4)
end

-- It has stood since then: what its tracks did since is no way.
local function was_held_since(pose)
	local now = robot.pose()
	for _, place in way do
		place.x += now.x - pose.x
		place.y += now.y - pose.y
	end
	BEGINNING.x += now.x - pose.x
	BEGINNING.y += now.y - pose.y
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
	local nearest = robot.pose()
	while task.now() - seen_at < LOST do
		local thing, frame = see()
		if thing then
			seen_at = task.now()
			local width = width_of(thing, frame)
			if width > widest then
				widest, nearer_at, nearest = width, seen_at, robot.pose()
			end
			if width >= settings.width then
				robot.stop()
				return true
			elseif seen_at - nearer_at > HELD then
				was_held_since(nearest)
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

-- Drops a place of the way that it has come to, and all that came after it. True if there was one.
local function come_to_a_place(pose)
	for place = 1, #way do
		if distance(way[place], pose) < REACHED then
			while #way >= place do
				table.remove(way)
			end
			return true
		end
	end
	return false
end

-- By how much it has to turn to look at a place: radians, left positive.
local function turn_to(place, pose)
	return whereabouts.wrap(math.atan2(place.y - pose.y, place.x - pose.x) - pose.heading)
end

-- Towards a place, but clear of what stands beside its way.
local function steer_back(off, free)
	local room = (if free.ahead < 1.5 * ROOM then 0.6 else 0.2) * free.turn
	local turning = math.clamp(1.2 * off + room, -0.6, 0.6)
	local beside = free.beside[if turning > 0 then "left" else "right"]
	robot.drive(settings.speed * (if free.ahead < ROOM then 0.5 else 1), if beside then 0 else turning)
end

-- Something held it: back, and on along the way where there is room.
local function back_off(free)
	robot.forward(-0.3)
	robot.turn(math.rad(40) * (if free.turn >= 0 then 1 else -1))
	robot.forward(0.3)
end

-- Back the way it came, to where it began, and towards its station when it sees that. When something has
-- held it HELDS times it is not sure any more where it is.
local function go_back()
	local over, near = task.now() + 20 + 2 * STEP * #way / settings.speed, floor.memory()
	local free_at, reached_at, changed_at, changed, looked_like, helds = task.now(), task.now(), 0, robot.pose(), nil, 0
	while task.now() < over and helds < HELDS do
		local frame, pose = robot.wait_frame(1), robot.pose()
		reached_at = if come_to_a_place(pose) then task.now() else reached_at
		local place = way[math.max(1, #way - 1)]
		local bearing, away
		if frame and distance(BEGINNING, pose) < NEARLY then -- elsewhere it may be something else
			bearing, away = station.find(frame)
		end
		if not place or (away and away < HERE) then
			break
		end
		local off, free = bearing or turn_to(place, pose), if frame then near:look(frame) else nil
		if not free then
			robot.stop() -- blind
		elseif task.now() - reached_at > SLOWEST then
			evade()
			looked_like, helds, reached_at = nil, helds + 1, task.now()
		elseif math.abs(off) > 0.6 then
			robot.drive(0, TURNING * math.sign(off))
			free_at, looked_like = task.now(), nil
		elseif free.ahead < 0.5 * ROOM and task.now() - free_at < WAITS then
			robot.stop() -- somebody walks by
			looked_like = nil
		else
			steer_back(off, free)
			free_at = if free.ahead >= 0.5 * ROOM then task.now() else free_at
			local looks = floor.texture(frame)
			if not looked_like or floor.differs(looks, looked_like) then
				looked_like, changed_at, changed = looks, task.now(), pose
			elseif task.now() - changed_at > STANDS then
				was_held_since(changed)
				back_off(free)
				looked_like, helds = nil, helds + 1
			end
		end
	end
	robot.stop()
end

-- Tells @spykee/whereabouts of a drive, as robot.pose() has it: a turn, a way, a turn.
local function accounted(drive, ...)
	local before = robot.pose()
	drive(...)
	local after = robot.pose()
	local x, y = after.x - before.x, after.y - before.y
	local way, turned = math.sqrt(x * x + y * y), after.heading - before.heading
	local along = if way > 0.05 then math.atan2(y, x) - before.heading else 0
	whereabouts.account(0, along, 1)
	whereabouts.account(way, 0, 1)
	whereabouts.account(0, turned - along, 1)
end

-- From where a search was in vain: towards the station if it was seen meanwhile, else to where there is room and
-- no search has been yet.
local function go_on()
	whereabouts.settle()
	local view = whereabouts.station() or whereabouts.widest()
	if view then
		local bearing = view.bearing or 0
		accounted(robot.turn, whereabouts.wrap(view.heading + bearing - whereabouts.heading()))
	end
	accounted(floor.drive_on, LEG, settings.speed)
end

-- The station shines only so far: where its light is not seen the robot goes on and tries again. While it
-- searches it turns round, and its pictures show all that is about it.
local function come_home()
	if distance(BEGINNING, robot.pose()) > HERE then
		log.info("back the way I came")
		go_back()
	end
	local home, code
	for _ = 1, settings.places do
		log.info("going home")
		whereabouts.begin_watching()
		local watching = robot.on("frame", whereabouts.watch)
		home, code = robot.dock({ retries = 0 })
		watching:off()
		if home or code ~= "base_not_found" then
			break
		end
		go_on()
	end
	assert(home, `could not dock: {code}`)
end

robot.undock()
robot.stream("video", true) -- all the way: its turns are seen, and so its way is true
robot.reset_pose()
remember_the_way()
local found = find()
if found then
	celebrate()
end
come_home()
robot.stream("video", false)
assert(found, `found nothing {settings.colour}`)
