-- A function without its end.
-- expect: check 3: the `function` that begins here has no `end`
robot.on("docked", function()
	print("home")
