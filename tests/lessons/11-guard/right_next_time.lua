-- right
local detector = vision.motion()
local next_time = 0
robot.on("frame", function(frame)
	local motion = detector:update(frame)
	local now = task.now()
	if motion and motion.blobs[1] and now >= next_time then
		next_time = now + 10
		frame:save("intruder.jpg")
		robot.play("alarm")
	end
end)
