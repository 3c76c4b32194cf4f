-- follow_ball: turns to a coloured ball and keeps it in front at arm's length; looks around when it
-- has lost it. Runs until it is ended.
--
-- COLOUR: what to follow. NEAR: the ball's width in pixels at the distance to keep; SLACK: how far
-- from it is still well. TURN: how hard to turn towards the ball, in rad/s for each radian. SPEED: the
-- most, in m/s.

local COLOUR = "red"
local NEAR = 90
local SLACK = 8
local TURN = 2.2
local SPEED = 0.22
local LOOK_AROUND = 0.7 -- rad/s
local GIVE_UP = 0.8 -- seconds without the ball until it counts as lost

local seen_at = -math.huge
local side = 1 -- where the ball was last seen: 1 left, -1 right
local state

local function become(new)
	if new ~= state then
		state = new
		log.info(new)
		robot.led("flash", new == "following")
	end
end

-- Full speed from afar, slower on the last stretch, back when the ball comes too near.
local function approach(ball)
	local missing = NEAR - ball.w
	if math.abs(missing) <= SLACK then
		return 0
	end
	return SPEED * math.clamp(2 * missing / NEAR, -0.4, 1)
end

local function follow(ball)
	seen_at = task.now()
	side = if ball.bearing >= 0 then 1 else -1
	-- Turn first, then drive: a ball at the border would be lost on the way.
	local ahead = math.max(0, 1 - 2.5 * math.abs(ball.bearing))
	robot.drive(approach(ball) * ahead, math.clamp(TURN * ball.bearing, -1.2, 1.2))
	become("following")
end

robot.on("frame", function(frame)
	local ball = frame:find_blobs(COLOUR, { pixels_threshold = 25, merge = true, margin = 4 })[1]
	if ball then
		follow(ball)
	elseif task.now() - seen_at > GIVE_UP then
		robot.drive(0, LOOK_AROUND * side)
		become("looking around")
	end
end)
