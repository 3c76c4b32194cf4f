-- explore: drives around with the help of the camera alone, towards the longest stretch of free
-- floor, and turns away from obstacles. If the picture does not change while the robot drives,
-- something that the camera does not show holds it, and it backs off. The module @spykee/floor
-- finds the free floor. When the battery is low, the watchdog takes the robot home; when it has
-- charged, it drives out again.

local floor = require("@spykee/floor")

local settings = params.declare({
	speed = { default = 0.2, min = 0.05, max = 0.3, unit = "m/s", doc = "speed straight ahead" },
	enough = { default = 80, min = 35, max = 100, unit = "%", doc = "leaves the station at this battery level" },
	margin = { default = 1.2, min = 0.7, max = 2, unit = "m", doc = "turns away when less than this is free ahead" },
})

local TURNING = 0.8 -- rad/s, on the spot
local BEND = 0.35 -- rad/s at most while driving: the camera shows little of the sides
local PATIENCE = 1.5 -- seconds of driving without a change of the picture
local BRIEF = 1 -- seconds: after a shorter drive it goes on turning as before, not to and fro

local turns = false -- whether it turns away from something
local away = 1 -- the side to which it does: 1 left, -1 right
local turned_since, drives_since = 0, -math.huge
local near = floor.memory()
local last_texture -- the texture of the floor at its last change
local changed_at = task.now()

-- Returns the turning to where there is more room, but not towards an obstacle beside the robot.
local function bend(free)
	local side = if free.turn > 0 then "left" else "right"
	return if free.beside[side] then 0 else BEND * free.turn
end

local function steer(free)
	local turning = bend(free)
	local wanted = settings.margin * (if turns then 1.3 else 1)
	if turns and task.now() - turned_since > 2 * math.pi / TURNING then
		wanted = 0.8 * settings.margin -- a full turn has shown no better direction
		near:forget()
	end
	if free.ahead > wanted then
		if turns then
			turns, drives_since = false, task.now()
		end
		robot.drive(settings.speed * math.min(1, free.ahead), turning)
	else
		if not turns and task.now() - drives_since > BRIEF then
			away, turned_since = (if free.turn >= 0 then 1 else -1), task.now()
		end
		turns = true
		robot.drive(0, TURNING * away)
	end
end

local function stuck(frame)
	local texture = floor.texture(frame)
	if not last_texture or turns or floor.differs(texture, last_texture) then
		last_texture, changed_at = texture, task.now()
	end
	return task.now() - changed_at > PATIENCE
end

local function back_off()
	log.info("something holds me: I back off")
	robot.forward(-0.2)
	robot.turn(math.rad(math.random(60, 120)) * (if math.random() < 0.5 then 1 else -1))
	last_texture, turns, drives_since = nil, false, -math.huge
end

-- Waits on the station until the battery is full enough, then leaves it and turns away from it.
local function rest()
	local battery = robot.battery()
	while battery and (battery.percent or 100) < settings.enough do
		battery = robot.wait_for("battery", 60) or robot.battery()
	end
	local _, why = floor.leave_station()
	if why == "safety" then
		robot.wait_for("battery", 60) -- its level is not known, and the watchdog lets it charge longer
	end
	last_texture, turns, drives_since = nil, false, -math.huge
end

while true do
	local frame = robot.wait_frame(1)
	if robot.docked() then
		rest()
	elseif not frame then
		robot.stop() -- without a picture
	elseif stuck(frame) then
		back_off()
	else
		steer(near:look(frame))
	end
end
