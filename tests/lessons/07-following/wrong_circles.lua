-- wrong: It is near the ball and still driving|It has lost the ball|did not stay there|It has pushed the ball away
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 25 })[1]
	if not ball then
		robot.drive(0, 0.6)
	elseif ball.w < 120 then
		robot.drive(0.2, 2 * ball.bearing)
	else
		robot.drive(0.1, 1)
	end
end)
