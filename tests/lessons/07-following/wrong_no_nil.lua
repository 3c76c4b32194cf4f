-- wrong: find_blobs found none
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 25 })[1]
	if ball.w < 120 then
		robot.drive(0.2, 2 * ball.bearing)
	else
		robot.stop()
	end
end)
