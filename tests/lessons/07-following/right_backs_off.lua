-- right
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 25 })[1]
	if not ball then
		robot.drive(0, 0.6)
	elseif ball.w > 150 then
		robot.drive(-0.1, 0)
	elseif ball.w > 115 then
		robot.stop()
	else
		robot.drive(0.2, 2 * ball.bearing)
	end
end)
