-- wrong: the right light is off
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	robot.led("left", ball ~= nil and ball.bearing > 0)
end)
