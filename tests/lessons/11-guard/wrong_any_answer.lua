-- wrong: There was an alarm although nothing had moved
local detector = vision.motion()
local last = -10
robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion and task.now() - last >= 10 then
		last = task.now()
		robot.play("alarm")
		frame:save("intruder.jpg")
	end
end)
