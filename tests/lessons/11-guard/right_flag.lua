-- right
local detector = vision.motion()
local quiet = true

robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion and #motion.blobs > 0 and quiet then
		quiet = false
		robot.play("alarm")
		frame:save("intruder.jpg")
		task.delay(10, function()
			quiet = true
		end)
	end
end)
