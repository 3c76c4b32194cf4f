-- spykee lesson 6: seeing
-- Points at the red ball: left light when it is to the left, right light when it is to the right.

robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	if ball then
		robot.led("left", ball.bearing > 0)
		robot.led("right", ball.bearing < 0)
	else
		robot.led("left", false)
		robot.led("right", false)
	end
end)
