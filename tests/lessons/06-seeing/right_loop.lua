-- right
while true do
	local frame = robot.wait_frame(1)
	local ball = frame and frame:find_blobs("red", { pixels_threshold = 40 })[1]
	local side = if not ball then "none" elseif ball.cx < 160 then "left" else "right"
	robot.led("left", side == "left")
	robot.led("right", side == "right")
end
