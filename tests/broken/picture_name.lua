-- A picture's name with a blank.
-- expect: check 4: Frame:save: the name may have letters
robot.on("frame", function(frame)
	frame:save("my picture.jpg")
end)
