-- wrong: A ball rolled by, but there was no alarm
local last = -10
robot.on("frame", function(frame)
	local detector = vision.motion()
	local motion = detector:update(frame)
	if motion and #motion.blobs > 0 and task.now() - last >= 10 then
		last = task.now()
		robot.play("alarm")
		frame:save("intruder.jpg")
	end
end)
