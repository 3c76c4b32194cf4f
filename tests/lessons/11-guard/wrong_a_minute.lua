-- wrong: there was no second alarm
local detector = vision.motion()
local last = -60
robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion and #motion.blobs > 0 and task.now() - last >= 60 then
		last = task.now()
		robot.play("alarm")
		frame:save("intruder.jpg")
	end
end)
