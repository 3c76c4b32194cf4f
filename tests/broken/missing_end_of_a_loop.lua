-- A loop without its end.
-- expect: check 3: the `while` that begins here has no `end`: it is missing before line 7
while not robot.docked() do
	print("not home")
	task.wait(1)

print("home")
