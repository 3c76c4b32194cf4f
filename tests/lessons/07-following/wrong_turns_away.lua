-- wrong: It does not drive towards the ball|but does not get near|still driving
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 25 })[1]
	if not ball then
		robot.drive(0, 0.6)
	elseif ball.w < 120 then
		robot.drive(0.2, -4 * ball.bearing)
	else
		robot.stop()
	end
end)
