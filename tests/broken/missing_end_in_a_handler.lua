-- An if without its end, in a handler.
-- expect: check 4: the `if` that begins here has no `end`: it is missing before line 6
robot.on("frame", function(frame)
	if frame.age > 1 then
		print("late")
end)
