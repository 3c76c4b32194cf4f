-- wrong: There was more than one alarm within ten seconds
local detector = vision.motion()
robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion and #motion.blobs > 0 then
		robot.play("alarm")
		frame:save("intruder.jpg")
	end
end)
