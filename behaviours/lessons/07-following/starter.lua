-- spykee lesson 7: following
-- Drives to the red ball and stops in front of it.
-- Here it turns towards the ball and stays where it is. It should go there.

robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 25 })[1]
	if ball then
		robot.drive(0, 2 * ball.bearing)
	else
		robot.drive(0, 0.6)
	end
end)
