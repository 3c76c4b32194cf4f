-- follow_line: drives along a line of tape on the floor, also round bends. The camera sees the
-- floor only from some distance on, so the robot remembers the points of the line that it has seen
-- and steers to the nearest point that it has not reached yet. For tight bends, bend the head down.
-- When there are no such points left, it turns to find the line again, first to the side where it
-- was last; when it sees it, it stops before it measures where the line is. After a full turn without
-- a line, it stands still until it sees one. Up to a metre away, the black foot of a station looks
-- like black tape.

local floor = require("@spykee/floor")

local settings = params.declare({
	colour = { default = "black", doc = "colour of the tape: a name, or one of the config's own colours" },
	speed = { default = 0.22, min = 0.05, max = 0.35, unit = "m/s", doc = "speed on a straight piece" },
	near = { default = 0.25, min = 0.1, max = 0.5, unit = "m", doc = "a point nearer than this counts as reached; larger values cut corners" },
})

local AHEAD = 0.1 -- metres from the robot's middle to the camera
-- Where it looks for the line: shares of the distance to the nearest floor in the picture.
local STRIPS = { 1.03, 1.11, 1.21, 1.32, 1.47, 1.61, 1.81, 2.02 }
local APART, GAP = 0.08, 0.3 -- metres: least and largest distance between two points of the line
local NEARER = 0.15 -- metres: a point seen from this much nearer replaces the known one
local WIDE = 24 -- pixels: for each such width the tape gives one point
local MARGIN = 24 -- pixels around a blob with which its brightness is compared
local DARK = 0.45 -- black tape is darker than this share of the floor's brightness
-- A new line must begin nearer than this share of the nearest floor, or than 0.9 m, and so near to the
-- middle of the picture, a share of its width.
local BEGINNING, MIDDLE = 1.1, 0.42
local LOOK_AROUND = 0.8 -- rad/s
local SETTLES = 0.4 -- seconds after such a turn in which pictures, which arrive late, may still show it
local FULL_TURN = 2.2 * math.pi / LOOK_AROUND
-- Seconds of turning to the first side: for a lost line, and for a line that was never seen.
local FIRST, GLANCE = 1.8 / LOOK_AROUND, 0.7 / LOOK_AROUND

floor.leave_station() -- has no effect if the robot is not on its station

-- Points still to reach: x metres ahead of the robot, y metres to its left, seen from `away`
-- metres.
local line = {}
local near = 0 -- metres from the camera to the nearest floor in the picture
local pose = robot.pose() -- where it was when the points were moved last
local seen_at, ever_seen = task.now(), false
local followed_at = task.now()
local side = 1 -- where to look for a lost line: 1 left, -1 right
local turned_at = -SETTLES -- when it last turned to look for the line
local in_sight = false -- whether this picture shows the line
local state

local function drive(speed, turning, new_state)
	robot.drive(speed, turning)
	if state ~= new_state then
		state = new_state
		log.info(state)
		robot.led("flash", state == "following")
	end
end

-- Updates the positions of all points after the robot has moved, and drops those reached or behind
-- it.
local function move_on()
	local now = robot.pose()
	local way = math.sqrt((now.x - pose.x) ^ 2 + (now.y - pose.y) ^ 2)
	local angle = now.heading - pose.heading
	pose = now
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

-- Adds a point. A known point is replaced only if it is seen from clearly nearer: otherwise the
-- nearest point would move along with the robot.
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

-- Whether a point belongs to the line. A line has no gaps, so it must be near a known point; the
-- first one must be right in front of the robot: in the corners of a picture, which are dark, the foot
-- of anything looks like tape.
local function belongs(x, y, central)
	for _, point in line do
		if math.abs(point.x - x) < GAP and math.abs(point.y - y) < GAP then
			return true
		end
	end
	return #line == 0 and x < AHEAD + math.max(0.9, BEGINNING * near) and central
end

-- Whether a lost line has just been found in a turn. The first sight of a line counts at once: it may be
-- out of the picture when the robot stands.
local function found_in_turn()
	return ever_seen and #line == 0 and task.now() < turned_at + SETTLES
end

local function note(frame, column, row)
	local ahead, y = frame:floor_position(column, row)
	local x = AHEAD + (ahead or 0)
	if ahead and belongs(x, y, math.abs(column / frame.width - 0.5) < MIDDLE) then
		in_sight = true
		if not found_in_turn() then
			remember(x, y, math.sqrt(ahead ^ 2 + y ^ 2))
		end
		seen_at, ever_seen = task.now(), true
	end
end

-- Whether a blob is black tape. The corners of a picture and the shadow at the foot of a wall may be
-- black too, but not much darker than what is around them.
local function is_tape(frame, blob)
	local x, y = math.max(0, blob.x - MARGIN), math.max(0, blob.y - MARGIN)
	local right = math.min(frame.width, blob.x + blob.w + MARGIN)
	local bottom = math.min(frame.height, blob.y + blob.h + MARGIN)
	local around = frame:brightness({ x, y, right - x, bottom - y })
	local dark = frame:brightness({ blob.x, blob.y, blob.w, blob.h })
	return dark < DARK * math.min(around, frame:brightness())
end

-- Returns the largest blob of tape around this row, or nil.
local function find_tape(frame, row)
	for _, blob in frame:find_blobs(settings.colour, { roi = { 0, row - 4, frame.width, 9 } }) do
		if settings.colour ~= "black" or is_tape(frame, blob) then
			return blob
		end
	end
	return nil
end

local function look(frame)
	near = floor.nearest(frame)
	for _, share in STRIPS do
		local _, row = frame:pixel_at(0, -math.atan(frame.lens_height / (share * near)))
		local tape = row and find_tape(frame, row)
		if tape then
			-- In a bend the tape lies across the picture, so more than one of its points is
			-- visible.
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
	in_sight = false
	look(frame)
	local point, distance = nearest()
	if point then
		-- Drives the arc that leads to the point; the tighter the arc, the slower.
		local bend = 2 * point.y / distance ^ 2
		local slow = settings.speed / (1 + 0.25 * math.abs(bend))
		side = if point.y > 0 then 1 else -1
		drive(slow, slow * bend, "following")
		followed_at = task.now()
		return
	end
	if in_sight then
		return drive(0, 0, "the line is in sight")
	end
	-- Looks to one side first, then all the way round by the other side.
	local first = if ever_seen then FIRST else GLANCE
	if task.now() - seen_at < FULL_TURN + 2 * first then
		turned_at = task.now()
		drive(0, LOOK_AROUND * (if task.now() - followed_at < first then side else -side), "looking for the line")
	else
		drive(0, 0, "no line in sight")
	end
end)
