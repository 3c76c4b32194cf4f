-- wrong: The ball is to the left, but the left light is off
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	if not ball then
		print("nothing")
	elseif ball.bearing > 0 then
		print("left")
	else
		print("right")
	end
end)
