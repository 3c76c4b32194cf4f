-- right
while true do
	local frame = robot.wait_frame(1)
	local ball = frame and frame:find_blobs("red", { pixels_threshold = 25 })[1]
	if not ball then
		robot.turn(math.rad(25))
	elseif ball.w >= 115 then
		robot.stop()
	else
		robot.drive(0.15, 2 * ball.bearing)
	end
end
