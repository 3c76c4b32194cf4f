-- wrong: the left light has gone off|the left light is off|The ball is no longer in sight
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	if ball and ball.bearing > 0 then
		robot.led("left", true)
		task.wait(0.2)
		robot.led("left", false)
		task.wait(4)
	elseif ball then
		robot.led("right", true)
		task.wait(0.2)
		robot.led("right", false)
		task.wait(4)
	end
end)
