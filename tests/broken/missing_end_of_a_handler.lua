-- A handler without its end.
-- expect: check 3: the `function` that begins here has no `end`: it is missing before line 5
robot.on("docked", function()
	print("home")
)
