-- wrong: The ball is to the left, but
robot.on("frame", function(frame)
	local ball = frame:find_blobs("blue", { pixels_threshold = 40 })[1]
	robot.led("left", ball ~= nil and ball.bearing > 0)
	robot.led("right", ball ~= nil and ball.bearing < 0)
end)
