-- spykee lesson 6: seeing
-- Points at the red ball: left light when it is to the left, right light when it is to the right.
-- Here it only says that it sees something. On which side is it?

robot.on("frame", function(frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	if ball then
		robot.led("flash", true)
	end
end)
