-- A method that is not called.
-- expect: check 4: `brightness` needs brackets after it
robot.on("frame", function(frame)
	if frame:brightness then
		print("bright")
	end
end)
