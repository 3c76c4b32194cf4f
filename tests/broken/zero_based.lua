-- Lists begin at 1.
-- expect: check 4: lists begin at 1: there is nothing at 0
robot.on("frame", function(frame)
	local ball = frame:find_blobs("red")[0]
	print(ball)
end)
