-- right
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 25 })[1]
	if ball then
		local ahead = math.clamp(0.004 * (120 - ball.w), 0, 0.25)
		robot.drive(ahead, if ahead > 0.01 then 1.5 * ball.bearing else 0)
	else
		robot.drive(0, -0.6)
	end
end)
