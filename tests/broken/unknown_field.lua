-- A letter too many in a field.
-- expect: check 5: a Blob has no 'cxx'; did you mean 'cx'?
robot.on("frame", function(frame)
	for _, blob in frame:find_blobs("red") do
		print(blob.cxx)
	end
end)
