-- right
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red")[1]
	local middle = frame.width / 2
	robot.led("left", false)
	robot.led("right", false)
	if ball ~= nil then
		if ball.cx < middle then
			robot.led("left", true)
		else
			robot.led("right", true)
		end
	end
end)
