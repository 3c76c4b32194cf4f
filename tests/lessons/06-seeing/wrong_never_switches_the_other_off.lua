-- wrong: The ball is to the right, but the left light is on too
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	if not ball then
		robot.led("all", false)
	elseif ball.bearing > 0 then
		robot.led("left", true)
	else
		robot.led("right", true)
	end
end)
