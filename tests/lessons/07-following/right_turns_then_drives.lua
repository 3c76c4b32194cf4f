-- right
while true do
	local frame = robot.wait_frame(2)
	local ball = frame and frame:find_blobs("red", { pixels_threshold = 25 })[1]
	if not ball then
		robot.turn(math.rad(30))
	elseif ball.w >= 110 then
		break
	else
		robot.turn(ball.bearing)
		robot.forward(0.1)
	end
end
