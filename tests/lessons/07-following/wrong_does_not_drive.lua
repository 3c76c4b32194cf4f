-- wrong: It does not drive towards the ball
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 25 })[1]
	if ball then
		robot.drive(0, 2 * ball.bearing)
	else
		robot.drive(0, 0.6)
	end
end)
