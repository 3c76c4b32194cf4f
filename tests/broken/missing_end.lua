-- A function without its end.
-- expect: check 3: the `function` that begins here has no `end`: it is missing at the end of the file
robot.on("docked", function()
	print("home")
