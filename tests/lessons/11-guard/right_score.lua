-- right
local detector = vision.motion()
local last = -10
robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion and motion.score > 0 and task.now() - last >= 10 then
		last = task.now()
		robot.play("alarm")
		frame:save("intruder.jpg")
	end
end)
