-- A field of the list instead of a thing in it.
-- expect: check 4: this is a list: its entries have 'cx', the list itself does not
robot.on("frame", function(frame)
	print(frame:find_blobs("red").cx)
end)
