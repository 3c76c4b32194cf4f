-- wrong: The ball is to the
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	robot.led("left", ball ~= nil and ball.cy < 120)
	robot.led("right", ball ~= nil and ball.cy >= 120)
end)
