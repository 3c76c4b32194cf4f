-- right
robot.on("frame", function(frame)
	robot.led("left", false)
	robot.led("right", false)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	if not ball then
		return
	end
	local side = if ball.bearing > 0 then "left" else "right"
	robot.led(side, true)
end)
