-- A field of the list instead of a thing in it.
-- expect: check 4: this is a list: it has no 'cx', only the things in it have
robot.on("frame", function(frame)
	print(frame:find_blobs("red").cx)
end)
