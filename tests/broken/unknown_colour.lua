-- A colour that does not exist.
-- expect: check 4: Frame:find_blobs: unknown colour 'gren'; did you mean 'green'?
robot.on("frame", function(frame)
	print(#frame:find_blobs("gren"))
end)
