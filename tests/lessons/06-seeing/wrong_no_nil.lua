-- wrong: find_blobs found none
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	robot.led("left", ball.bearing > 0)
	robot.led("right", ball.bearing < 0)
end)
