-- wrong: light is on too
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	robot.led("left", ball ~= nil)
	robot.led("right", ball ~= nil)
end)
