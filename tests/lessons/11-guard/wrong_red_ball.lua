-- wrong: There was an alarm although nothing had moved
local last = -10
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red")[1]
	if ball and task.now() - last >= 10 then
		last = task.now()
		robot.play("alarm")
		frame:save("intruder.jpg")
	end
end)
