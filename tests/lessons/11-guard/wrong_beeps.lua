-- wrong: A ball rolled by, but there was no alarm
local detector = vision.motion()
local last = -10
robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion and #motion.blobs > 0 and task.now() - last >= 10 then
		last = task.now()
		robot.play("bip_2")
		frame:save("intruder.jpg")
	end
end)
