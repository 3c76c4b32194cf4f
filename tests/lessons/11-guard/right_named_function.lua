-- right
local detector = vision.motion()
local last_alarm = nil

local function sound_the_alarm(frame)
	robot.play("alarm")
	frame:save("intruder.jpg")
	last_alarm = task.now()
end

local function look(frame)
	local motion = detector:update(frame)
	if not motion or #motion.blobs == 0 then
		return
	end
	if last_alarm == nil or task.now() - last_alarm > 10 then
		sound_the_alarm(frame)
	end
end

robot.on("frame", look)
