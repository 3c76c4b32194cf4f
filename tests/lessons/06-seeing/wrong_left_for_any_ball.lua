-- wrong: The ball is to the right, but the left light is on instead
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	robot.led("left", ball ~= nil)
	robot.led("right", false)
end)
