-- right
local NEAR = 120

local function find(frame)
	return frame:find_blobs("red", { pixels_threshold = 25 })[1]
end

local function go(ball)
	if ball == nil then
		robot.drive(0, 0.6)
		return
	end
	if ball.w >= NEAR then
		robot.stop()
		return
	end
	robot.drive(0.15, 1.5 * ball.bearing)
end

robot.on("frame", function(frame)
	go(find(frame))
end)
