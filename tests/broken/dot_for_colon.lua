-- A frame is called with a colon.
-- expect: check 4: find_blobs must be called with a colon: frame:find_blobs(...)
robot.on("frame", function(frame)
	local blobs = frame.find_blobs("red")
	print(#blobs)
end)
