-- follow_colour: turns to an object of one colour, such as a red ball, and keeps at arm's length in
-- front of it; looks around when it has lost the object. Runs until it is stopped.

local settings = params.declare({
	colour = { default = "red", doc = "what to follow: a name, or one of the config's own colours" },
	width = { default = 125, min = 20, max = 200, unit = "px", doc = "width of the object in the picture at the distance to keep" },
	speed = { default = 0.22, min = 0.05, max = 0.4, unit = "m/s", doc = "the highest speed" },
	turn = { default = 2.2, min = 0.5, max = 5, unit = "1/s", doc = "how hard it turns: rad/s for each radian" },
})

robot.undock() -- has no effect if the robot is not on its station

local SLACK = 8 -- pixels by which the width may differ from the right one
local LOOK_AROUND = 0.9 -- rad/s
local GIVE_UP = 0.8 -- seconds out of sight until it counts as lost

local seen_at = -math.huge
local side = 1 -- where it was last seen: 1 left, -1 right
local state

local function become(new)
	if new ~= state then
		state = new
		log.info(new)
		robot.led("flash", new == "following")
	end
end

-- Returns the speed: full when the object is far away, slower near it, backwards when it is too
-- near.
local function approach(thing)
	local missing = settings.width - thing.w
	if math.abs(missing) <= SLACK then
		return 0
	end
	return settings.speed * math.clamp(2 * missing / settings.width, -0.4, 1)
end

local function follow(thing)
	seen_at = task.now()
	side = if thing.bearing >= 0 then 1 else -1
	-- Turn first, then drive: an object at the border of the picture would get lost on the way.
	local ahead = math.max(0, 1 - 2.5 * math.abs(thing.bearing))
	robot.drive(approach(thing) * ahead, math.clamp(settings.turn * thing.bearing, -1.2, 1.2))
	become("following")
end

robot.on("frame", function(frame)
	local thing = frame:find_blobs(settings.colour, { pixels_threshold = 25, merge = true, margin = 4 })[1]
	if thing then
		follow(thing)
	elseif task.now() - seen_at > GIVE_UP then
		robot.drive(0, LOOK_AROUND * side)
		become("looking around")
	end
end)
