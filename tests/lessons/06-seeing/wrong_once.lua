-- wrong: The ball is to the right, but the left light is on instead
local frame = robot.wait_frame(5)
local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
if ball then
	robot.led("left", ball.bearing > 0)
	robot.led("right", ball.bearing < 0)
end
