-- Drives about without looking where it goes, camera on: straight on, in curves, and now and then backwards. Its log
-- says of each motion how many seconds it is to last, when it is told that it is held, and once a minute where it
-- believes to be.
if robot.docked() and robot.undock() then
	robot.turn(math.pi)
end
robot.stream("video", true)
robot.wait_frame(5)

-- What a motion answers, and whether the robot was held.
local function went(ok, code)
	if code == "blocked" then
		log.info("blocked")
		return false
	end
	if not ok then
		task.wait(1)
	end
	return true
end

local function forward(metres, speed)
	log.info(`for {math.abs(metres) / speed} straight`)
	return went(robot.forward(metres, speed))
end

local function curve(speed, angular, seconds)
	log.info(`for {seconds} curve`)
	return went(robot.drive(speed, angular, seconds))
end

local function turn(degrees)
	log.info(`for 0 turn`)
	return went(robot.turn(math.rad(degrees)))
end

local function either()
	return if math.random() < 0.5 then 1 else -1
end

local function begin_at_origin()
	robot.reset_pose()
	log.info("origin")
	return task.now()
end

local began = begin_at_origin()
while true do
	if task.now() - began > 60 then
		task.wait(0.5)
		local pose = robot.pose()
		log.info(`pose {pose.x} {pose.y} {math.deg(pose.heading)}`)
		began = begin_at_origin()
	end
	local speed = 0.12 + 0.23 * math.random()
	local what, metres = math.random(), 0.5 + 3 * math.random()
	if what < 0.7 then
		if not forward(metres, speed) then
			forward(-0.6, 0.2)
		end
	elseif what < 0.9 then
		if not curve(speed, either() * (0.1 + 0.4 * math.random()), metres / speed) then
			forward(-0.6, 0.2)
		end
	elseif not forward(-metres / 2, speed) then
		forward(0.4, 0.2)
	end
	turn(math.random(70, 180) * either())
end
