-- wrong: It does not drive towards the ball|but does not get near|still driving
local frame = robot.wait_frame(5)
local ball = frame:find_blobs("red", { pixels_threshold = 25 })[1]
if ball and ball.w < 120 then
	robot.drive(0.2, 2 * ball.bearing, 2)
else
	robot.stop()
end
