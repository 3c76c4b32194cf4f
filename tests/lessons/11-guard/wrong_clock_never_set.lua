-- wrong: There was more than one alarm within ten seconds
local detector = vision.motion()
local last = -10
robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion and #motion.blobs > 0 and task.now() - last >= 10 then
		robot.play("alarm")
		frame:save("intruder.jpg")
	end
end)
