-- explore: drives about by the camera alone, to where the floor is free the farthest, and turns away
-- from whatever stands in the way. When the picture stands still although it drives, something that it
-- does not see holds it: it backs off. How it sees the floor is in @spykee/floor. The watchdog takes it
-- home when its battery is low; charged, it goes out again.

local floor = require("@spykee/floor")

local settings = params.declare({
	speed = { default = 0.2, min = 0.05, max = 0.3, unit = "m/s", doc = "straight ahead" },
	enough = { default = 80, min = 25, max = 100, unit = "%", doc = "leaves the station at this battery level" },
	margin = { default = 0.9, min = 0.7, max = 2, unit = "m", doc = "turns away when less than this is free ahead" },
})

local TURNING = 0.8 -- rad/s, on the spot
local BEND = 0.35 -- rad/s at most, under way: it sees little of what is beside its way
local PATIENCE = 1.5 -- seconds of driving without a change of the picture

local away -- the side to which it turns away: 1 left, -1 right; nil while it drives
local turned_since
local near = floor.memory()
local looked_like -- the floor, when last it changed
local changed_at = task.now()

-- To where there is more room, but not into what is beside it.
local function bend(free)
	local side = if free.turn > 0 then "left" else "right"
	return if free.beside[side] then 0 else BEND * free.turn
end

local function steer(free)
	local turning = bend(free)
	local wanted = settings.margin * (if away then 1.3 else 1)
	if away and task.now() - turned_since > 2 * math.pi / TURNING then
		wanted = 0.8 * settings.margin -- no better way all round
		near:forget()
	end
	if free.ahead > wanted then
		away = nil
		robot.drive(settings.speed * math.min(1, free.ahead), turning)
	else
		if not away then
			away, turned_since = (if free.turn >= 0 then 1 else -1), task.now()
		end
		robot.drive(0, TURNING * away)
	end
end

local function stuck(frame)
	local looks = floor.texture(frame)
	if not looked_like or away or floor.differs(looks, looked_like) then
		looked_like, changed_at = looks, task.now()
	end
	return task.now() - changed_at > PATIENCE
end

local function back_off()
	log.info("something holds me: I back off")
	robot.forward(-0.2)
	robot.turn(math.rad(math.random(60, 120)) * (if math.random() < 0.5 then 1 else -1))
	looked_like, away = nil, nil
end

-- On the station until the battery is full enough, then out, and its back to it.
local function rest()
	local battery = robot.battery()
	while battery and battery.percent < settings.enough do
		battery = robot.wait_for("battery", 60) or robot.battery()
	end
	if robot.undock() then
		robot.turn(math.pi)
	end
	looked_like, away = nil, nil
end

while true do
	local frame = robot.wait_frame(1)
	if robot.docked() then
		rest()
	elseif not frame then
		robot.stop() -- blind
	elseif stuck(frame) then
		back_off()
	else
		steer(near:look(frame))
	end
end
