-- follow_line: drives along a line of tape on the floor, also round bends. The camera sees the floor
-- only from two thirds of a metre on, so the robot remembers where the line lay and steers to the nearest
-- point that it has not reached yet. Out of such points it turns to find the line again, first to the side
-- where it was; after a full turn without it, it stands still until it sees one.

local settings = params.declare({
	colour = { default = "black", doc = "of the tape: a name, or one of the config's own colours" },
	speed = { default = 0.22, min = 0.05, max = 0.35, unit = "m/s", doc = "on a straight piece" },
	near = { default = 0.25, min = 0.1, max = 0.5, unit = "m", doc = "a point nearer than this is reached; more cuts corners" },
})

-- The camera: above the floor and before the robot's middle, metres.
local HEIGHT, AHEAD = 0.2, 0.1
local STRIPS = { 0.64, 0.69, 0.75, 0.82, 0.91, 1, 1.12, 1.25 } -- metres before the camera that are looked at
local APART, GAP = 0.08, 0.3 -- metres between two points of the line, at least and at most
local NEARER = 0.15 -- metres: a point seen from so much nearer is better known
local WIDE = 24 -- pixels: tape that looks as wide gives two points or more
local BEGINNING = 1 -- metres ahead: a new line is seen so near
local LOOK_AROUND = 0.8 -- rad/s
local FULL_TURN = 2.2 * math.pi / LOOK_AROUND
local FIRST, GLANCE = 1.8 / LOOK_AROUND, 0.7 / LOOK_AROUND -- seconds to one side first: a lost line, and one not seen yet

robot.undock() -- nothing happens when it is not on its station

-- Points still to reach: x metres ahead of the robot, y metres to its left, seen from so far away.
local line = {}
local speed, turning = 0, 0 -- what the tracks do now, m/s and rad/s
local moved_at = task.now()
local seen_at, ever_seen = task.now(), false
local followed_at = task.now()
local side = 1 -- where to look for a lost line: 1 left, -1 right
local state

local function drive(new_speed, new_turning, new_state)
	speed, turning = new_speed, new_turning
	robot.drive(speed, turning)
	if state ~= new_state then
		state = new_state
		log.info(state)
		robot.led("flash", state == "following")
	end
end

-- The robot has moved: all points have come nearer and turned. Those reached or behind are done.
local function move_on()
	local now = task.now()
	local way, angle = speed * (now - moved_at), turning * (now - moved_at)
	moved_at = now
	local cos, sin = math.cos(angle), math.sin(angle)
	local left = {}
	for _, point in line do
		local x, y = point.x - way, point.y
		x, y = cos * x + sin * y, cos * y - sin * x
		if x > 0 and math.sqrt(x * x + y * y) > settings.near then
			table.insert(left, { x = x, y = y, away = point.away })
		end
	end
	line = left
end

-- What is seen again from as near stays as it is: else the nearest point would be taken along with the robot.
local function remember(x, y, away)
	for i = #line, 1, -1 do
		local known = line[i]
		if math.abs(known.x - x) < APART and math.abs(known.y - y) < APART then
			if away > known.away - NEARER then
				return
			end
			table.remove(line, i)
		end
	end
	table.insert(line, { x = x, y = y, away = away })
end

-- A line has no gaps: what lies far from all of it is something else. It begins right before the robot.
local function belongs(x, y)
	for _, point in line do
		if math.abs(point.x - x) < GAP and math.abs(point.y - y) < GAP then
			return true
		end
	end
	return #line == 0 and x < BEGINNING
end

local function note(frame, column, row)
	local bearing, elevation = frame:direction(column, row)
	local away = HEIGHT / math.tan(-elevation)
	local x, y = AHEAD + away * math.cos(bearing), away * math.sin(bearing)
	if belongs(x, y) then
		remember(x, y, away)
		seen_at, ever_seen = task.now(), true
	end
end

local function look(frame)
	for _, depth in STRIPS do
		local _, row = frame:pixel_at(0, -math.atan(HEIGHT / depth))
		local tape = row and frame:find_blobs(settings.colour, { roi = { 0, row - 4, frame.width, 9 } })[1]
		if tape then
			-- In a bend the tape lies across the picture: more than one point of it is seen.
			local points = math.max(1, tape.w // WIDE)
			for point = 1, points do
				local column = if points == 1 then tape.cx else tape.x + (point - 0.5) * tape.w / points
				note(frame, column, tape.cy)
			end
		end
	end
end

local function nearest()
	local best, least = nil, math.huge
	for _, point in line do
		local distance = math.sqrt(point.x ^ 2 + point.y ^ 2)
		if distance < least then
			best, least = point, distance
		end
	end
	return best, least
end

robot.on("frame", function(frame)
	move_on()
	look(frame)
	local point, distance = nearest()
	if point then
		-- The arc that leads to it; slower the tighter it is.
		local bend = 2 * point.y / distance ^ 2
		local slow = settings.speed / (1 + 0.25 * math.abs(bend))
		side = if point.y > 0 then 1 else -1
		drive(slow, slow * bend, "following")
		followed_at = task.now()
		return
	end
	-- To the one side first, and if it is not there all round by the other.
	local first = if ever_seen then FIRST else GLANCE
	if task.now() - seen_at < FULL_TURN + 2 * first then
		drive(0, LOOK_AROUND * (if task.now() - followed_at < first then side else -side), "looking for the line")
	else
		drive(0, 0, "no line far and wide")
	end
end)
