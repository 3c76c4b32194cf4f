-- wrong: A ball rolled by, but there was no alarm|A lamp was switched, which is no reason for an alarm
local before
local last = -10
robot.on("frame", function(frame)
	local now = frame:brightness()
	if before and math.abs(now - before) > 5 and task.now() - last >= 10 then
		last = task.now()
		robot.play("alarm")
		frame:save("intruder.jpg")
	end
	before = now
end)
