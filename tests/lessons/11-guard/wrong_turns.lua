-- wrong: A ball rolled by, but there was no alarm|There was an alarm although nothing had moved
local detector = vision.motion()
local last = -10
robot.drive(0, 0.3)
robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion and #motion.blobs > 0 and task.now() - last >= 10 then
		last = task.now()
		robot.play("alarm")
		frame:save("intruder.jpg")
	end
end)
task.wait(1000)
