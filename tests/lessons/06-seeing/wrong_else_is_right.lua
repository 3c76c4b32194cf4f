-- wrong: The ball is no longer in sight, but a light is still on
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	if ball and ball.bearing > 0 then
		robot.led("left", true)
		robot.led("right", false)
	else
		robot.led("left", false)
		robot.led("right", true)
	end
end)
