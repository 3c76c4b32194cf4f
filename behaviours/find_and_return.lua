-- find_and_return: looks for an object of one colour, drives up to it, photographs it and comes
-- home to the station. It looks around, and if it sees no such object it drives on to where there
-- is room and looks around there. It remembers its path and drives back along it until it finds the
-- station. Ends on the station, or with an error if it found nothing or did not get home.

local floor = require("@spykee/floor")
local station = require("@spykee/station")
local whereabouts = require("@spykee/whereabouts")

local settings = params.declare({
	colour = { default = "red", doc = "what to look for: a name, or one of the config's own colours" },
	width = { default = 82, min = 20, max = 200, unit = "px", doc = "width of the object in a picture of 320 columns when the robot has reached it" },
	places = { default = 20, min = 1, max = 100, doc = "the largest number of places where it looks around" },
	speed = { default = 0.27, min = 0.05, max = 0.3, unit = "m/s", doc = "speed of the drive" },
})

local TURNING = 1.0 -- rad/s
local LOST = 1.5 -- seconds out of sight until the object counts as lost
local HELD = 5 -- seconds without coming nearer until the robot counts as held
local ROOM = 0.8 -- metres that must be free in front of the camera
-- Where its path begins, and within how many metres of it the robot is nearly there.
local BEGINNING, NEARLY = { x = 0, y = 0 }, 3
-- Metres between two places of its path, and from a place that counts as reached.
local STEP, REACHED = 0.3, 0.35
local HERE = 2 -- metres from its beginning or its station that need no drive back
local BESIDE = { math.rad(20), math.rad(40) } -- views at these angles from a view are beside it
-- Metres ahead at which a direction is judged, and from its path at which a place counts as new.
local REACH, NEW = 2, 1.5
local STANDS = 1.5 -- seconds of driving without a change of the picture until it counts as held
local MAX_HELD = 4 -- how often something may hold it on its way back
local SLOWEST = 10 -- seconds at most from one place of its path to the next
local WAITS = 3 -- seconds that it waits for a person in its way

local way = {} -- where it has been: positions of robot.pose(), in metres

local function distance(place, pose)
	return math.sqrt((place.x - pose.x) ^ 2 + (place.y - pose.y) ^ 2)
end

local function remember_the_way()
	local pose = robot.pose()
	if #way == 0 or distance(way[#way], pose) > STEP then
		table.insert(way, { x = pose.x, y = pose.y })
	end
end

-- Returns the object, if it is in sight, and the frame.
local function see()
	local frame = robot.wait_frame(1)
	remember_the_way()
	return frame and frame:find_blobs(settings.colour, { pixels_threshold = 40, merge = true, margin = 4 })[1], frame
end

-- Returns the width of the object, converted to pixels of a picture of 320x240.
local function width_of(thing, frame)
	return thing.w * 320 / frame.width
end

-- Returns how new a place is: the metres to the nearest place where the robot has been, at most
-- NEW.
local function newness(place)
	local new = NEW
	for _, been in way do
		new = math.min(new, distance(been, place))
	end
	return new
end

-- Returns the mean free distance on both sides of a view.
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

-- Returns the most promising heading: one with much room, through a gap, and towards places where
-- the robot has not been. Partly random, because otherwise it would drive the same way again and
-- again.
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

-- The side to which it turns. It alternates, so that errors of the estimated turns cancel out.
local side = 1

-- Turns until it sees the object, at most once round. If it does not see it, it ends up facing the
-- most promising direction.
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

-- Backs off and drives a little to the side, because something held the robot.
local function evade()
	log.info("something holds me: I go round it")
	robot.forward(-0.4)
	robot.turn(math.rad(math.random(50, 80)) * (if math.random() < 0.5 then 1 else -1))
	robot.forward(0.4)
end

-- Corrects the path: the robot has not moved since this pose, although its tracks ran.
local function correct_path(pose)
	local now = robot.pose()
	for _, place in way do
		place.x += now.x - pose.x
		place.y += now.y - pose.y
	end
	BEGINNING.x += now.x - pose.x
	BEGINNING.y += now.y - pose.y
end

-- Drives towards the object; passes an obstacle in between on the side where there is more room.
local function steer(thing, frame)
	local free = floor.look(frame)
	if free.ahead < ROOM and width_of(thing, frame) < settings.width / 2 then
		robot.drive(0.7 * settings.speed, if free.left > free.right then 0.6 else -0.6)
	else
		robot.drive(settings.speed * math.max(0, 1 - 2 * math.abs(thing.bearing)), 1.5 * thing.bearing)
	end
end

-- Drives up to the object. Returns false if it gets lost on the way, or if something holds the
-- robot.
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
				correct_path(nearest)
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
	log.warn(`found nothing {settings.colour} anywhere`)
	return false
end

local function celebrate()
	local frame = robot.wait_frame(2)
	log.info(`found {settings.colour}`, { picture = frame and frame:save(`{settings.colour}.jpg`) or "none" })
	robot.play("laugh")
	robot.blink("all", { on = 0.2, off = 0.2, count = 3 }):join()
end

-- Removes a place of the path that the robot has reached, and all later ones. Returns true if there
-- was such a place.
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

-- Returns the angle by which it must turn to face a place: radians, left positive.
local function turn_to(place, pose)
	return whereabouts.wrap(math.atan2(place.y - pose.y, place.x - pose.x) - pose.heading)
end

-- Drives towards a place, but keeps clear of obstacles beside its way.
local function steer_back(off, free)
	local room = (if free.ahead < 1.5 * ROOM then 0.6 else 0.2) * free.turn
	local turning = math.clamp(1.2 * off + room, -0.6, 0.6)
	local beside = free.beside[if turning > 0 then "left" else "right"]
	robot.drive(settings.speed * (if free.ahead < ROOM then 0.5 else 1), if beside then 0 else turning)
end

-- Backs off and passes on the side where there is room, because something held the robot.
local function back_off(free)
	robot.forward(-0.3)
	robot.turn(math.rad(40) * (if free.turn >= 0 then 1 else -1))
	robot.forward(0.3)
end

-- Drives back along its path to the beginning, and towards its station when it sees it. Gives up
-- when something has held it MAX_HELD times, because its position is then too uncertain.
local function go_back()
	local over, near = task.now() + 20 + 2 * STEP * #way / settings.speed, floor.memory()
	local free_at, reached_at, changed_at, changed, last_texture, times_held = task.now(), task.now(), 0, robot.pose(), nil, 0
	while task.now() < over and times_held < MAX_HELD do
		local frame, pose = robot.wait_frame(1), robot.pose()
		reached_at = if come_to_a_place(pose) then task.now() else reached_at
		local place = way[math.max(1, #way - 1)]
		local bearing, away
		-- Farther away, something else may look like the station.
		if frame and distance(BEGINNING, pose) < NEARLY then
			bearing, away = station.find(frame)
		end
		if not place or (away and away < HERE) then
			break
		end
		local off, free = bearing or turn_to(place, pose), if frame then near:look(frame) else nil
		if not free then
			robot.stop() -- without a picture
		elseif task.now() - reached_at > SLOWEST then
			evade()
			last_texture, times_held, reached_at = nil, times_held + 1, task.now()
		elseif math.abs(off) > 0.6 then
			robot.drive(0, TURNING * math.sign(off))
			free_at, last_texture = task.now(), nil
		elseif free.ahead < 0.5 * ROOM and task.now() - free_at < WAITS then
			robot.stop() -- somebody walks by
			last_texture = nil
		else
			steer_back(off, free)
			free_at = if free.ahead >= 0.5 * ROOM then task.now() else free_at
			local texture = floor.texture(frame)
			if not last_texture or floor.differs(texture, last_texture) then
				last_texture, changed_at, changed = texture, task.now(), pose
			elseif task.now() - changed_at > STANDS then
				correct_path(changed)
				back_off(free)
				last_texture, times_held = nil, times_held + 1
			end
		end
	end
	robot.stop()
end

-- Comes home. The station's beacon has a limited range: where it is not received, the robot looks for
-- the station, drives nearer and searches again.
local function come_home()
	if distance(BEGINNING, robot.pose()) > HERE then
		log.info("back the way I came")
		go_back()
	end
	local home, code
	for _ = 1, settings.places do
		log.info("going home")
		home, code = robot.dock({ retries = 0 })
		if home or code ~= "base_not_found" then
			break
		end
		station.drive_nearer()
	end
	assert(home, `could not dock: {code}`)
end

robot.undock()
robot.stream("video", true) -- on all the time: pictures of its turns make its path more exact
robot.reset_pose()
remember_the_way()
local found = find()
if found then
	celebrate()
end
come_home()
robot.stream("video", false)
assert(found, `found nothing {settings.colour}`)
