-- wrong: It has pushed the ball away|It has lost the ball
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 25 })[1]
	if not ball then
		robot.drive(0, 0.6)
	elseif ball.w < 300 then
		robot.drive(0.2, 2 * ball.bearing)
	else
		robot.stop()
	end
end)
