-- The first of a list that is empty, in a variable.
-- expect: run 5: `ball` is nil here, so `ball.cx` cannot be read
local function look(frame)
	local ball = frame:find_blobs("red")[1]
	print(ball.cx)
end
look(robot.wait_frame(5))
