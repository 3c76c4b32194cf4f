-- right
local there = false

robot.on("frame", function(frame)
	if there then
		return
	end
	local ball = frame:find_blobs("red", { pixels_threshold = 25 })[1]
	if not ball then
		robot.drive(0, 0.5)
	elseif ball.w < 120 then
		robot.drive(0.2, 2 * ball.bearing)
	else
		there = true
		robot.stop()
	end
end)
