-- wrong: there was no second alarm
local detector = vision.motion()
local seen = false
robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion and #motion.blobs > 0 and not seen then
		seen = true
		robot.play("alarm")
		frame:save("intruder.jpg")
	end
end)
