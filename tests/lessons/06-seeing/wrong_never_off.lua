-- wrong: The ball is no longer in sight, but a light is still on
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	if ball then
		robot.led("left", ball.bearing > 0)
		robot.led("right", ball.bearing < 0)
	end
end)
