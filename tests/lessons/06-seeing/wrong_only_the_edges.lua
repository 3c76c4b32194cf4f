-- wrong: The ball is to the left, but the left light is off
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	robot.led("left", ball ~= nil and ball.bearing > 0.5)
	robot.led("right", ball ~= nil and ball.bearing < -0.5)
end)
