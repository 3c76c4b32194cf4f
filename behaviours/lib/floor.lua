-- floor: sees how far the floor before the robot is free, in one picture, without knowing the room.
--
--     local floor = require("./lib/floor")
--     robot.on("frame", function(frame)
--         local free = floor.look(frame)
--         robot.drive(if free.ahead > 0.8 then 0.2 else 0, free.turn)
--     end)
--
-- floor.look(frame) gives what is free, in metres before the camera: `ahead`, as wide as the robot; `left`
-- and `right`, the least in either half of the picture; and `turn`, from -1 (to the right is more
-- room) to 1 (to the left is).
--
-- floor.drive_on(seconds, speed, done) drives for so long to where there is room, or until `done`
-- answers true.
--
-- floor.texture(frame) is what the floor looks like, and floor.differs(one, other) whether two of these
-- differ: they do when the robot has moved.
--
-- In each column it looks from below and from above. From below: what is right before the robot is
-- floor, and what is unlike it stands on it. From above: what is as high as the camera is a wall or a
-- thing, down to the first edge; that may be the top of its skirting board, so it is taken for nearer
-- than the edge looks. The nearer of the two counts.

local HEIGHT = 0.2 -- of the camera above the floor, metres
local MIDDLE, HORIZON, FOCAL, BOTTOM = 160, 120, 277, 238 -- of its picture, pixels
local COLUMNS, STEP = 12, 4
local SKIRTING = 0.5 -- as high as the camera, at most
local HALF_WIDTH = 0.22 -- of the way that the robot needs, metres

local function depth_of(row)
	return HEIGHT * FOCAL / math.max(row - HORIZON, 5)
end

-- The colour of a place: brightness, and what does not change when the light does.
local function colour_at(frame, x, y)
	local r, g, b = frame:get_pixel(x, y)
	return (r + g + b) / 3, r - g, g - b
end

-- What the floor looks like: samples from the strip right before the robot.
local function samples(frame)
	local list = {}
	for x = 40, 280, 60 do
		for y = 214, BOTTOM, 12 do
			local light, red, yellow = colour_at(frame, x, y)
			table.insert(list, { light = light, red = red, yellow = yellow })
		end
	end
	return list
end

local function like_floor(list, light, red, yellow)
	for _, sample in list do
		if
			math.abs(sample.light - light) < 40
			and math.abs(sample.red - red) + math.abs(sample.yellow - yellow) < 16
		then
			return true
		end
	end
	return false
end

-- The lowest row that does not look like floor, and nor does the one above it.
local function from_below(frame, x, list)
	local strange = 0
	for y = BOTTOM, HORIZON, -STEP do
		strange = if like_floor(list, colour_at(frame, x, y)) then 0 else strange + 1
		if strange == 2 then
			return y + STEP
		end
	end
	return HORIZON
end

-- The row at which what crosses the horizon ends.
local function from_above(frame, x)
	local light, red, yellow = colour_at(frame, x, HORIZON - 4)
	for y = HORIZON, BOTTOM, STEP do
		local l, r, w = colour_at(frame, x, y)
		if math.abs(l - light) > 12 or math.abs(r - red) + math.abs(w - yellow) > 10 then
			return y
		end
		light += 0.2 * (l - light)
	end
	return BOTTOM
end

local function free_in_column(frame, x, list)
	local below = depth_of(from_below(frame, x, list))
	local above = depth_of(from_above(frame, x)) * (1 - SKIRTING)
	return math.min(below, above)
end

local function look(frame)
	local list = samples(frame)
	local free = { ahead = math.huge, left = math.huge, right = math.huge, turn = 0 }
	local sum, difference = 0, 0
	for column = 1, COLUMNS do
		local x = math.floor((column - 0.5) * frame.width / COLUMNS)
		local depth = math.min(free_in_column(frame, x, list), 4)
		if math.abs(x - MIDDLE) / FOCAL * depth < HALF_WIDTH then
			free.ahead = math.min(free.ahead, depth)
		end
		local half = if x < MIDDLE then "left" else "right"
		free[half] = math.min(free[half], depth)
		sum += depth
		difference += if x < MIDDLE then depth else -depth
	end
	free.turn = difference / sum
	return free
end

-- The brightness of small patches of the floor: it changes as soon as the robot moves.
local function texture(frame)
	local patches = {}
	for y = 150, 230, 20 do
		for x = 20, 290, 30 do
			table.insert(patches, frame:brightness({ x, y, 6, 6 }))
		end
	end
	return patches
end

-- Whether two textures are more unlike than the camera's noise makes them.
local function differs(one, other)
	local sum = 0
	for i, brightness in one do
		sum += math.abs(brightness - other[i])
	end
	return sum / #one > 0.008
end

local ROOM = 0.6 -- metres that must be free ahead
local TURNING = 0.7 -- rad/s
local PATIENCE = 1.5 -- seconds of driving without a change of the picture

-- Drives on for some seconds to where there is room, or until `done` answers true. When something that it
-- does not see holds it, it backs off and turns away.
local function drive_on(seconds, speed, done)
	local away = if math.random() < 0.5 then 1 else -1
	local over = task.now() + seconds
	local looked_like, changed_at
	while task.now() < over and not (done and done()) do
		local frame = robot.wait_frame(1)
		local free = frame and look(frame)
		if not (free and free.ahead > ROOM) then
			robot.drive(0, TURNING * away)
			looked_like = nil
			continue
		end
		local looks = texture(frame)
		if not looked_like or differs(looks, looked_like) then
			looked_like, changed_at = looks, task.now()
		end
		if task.now() - changed_at > PATIENCE then
			robot.forward(-0.2)
			robot.turn(math.rad(math.random(60, 120)) * away)
			looked_like = nil
		else
			robot.drive(speed, 0.6 * free.turn)
		end
	end
	robot.stop()
end

return { look = look, drive_on = drive_on, texture = texture, differs = differs }
