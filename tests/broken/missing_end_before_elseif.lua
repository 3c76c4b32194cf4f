-- A loop without its end, before the elseif of the if around it.
-- expect: check 4: the `while` that begins here has no `end`: it is missing before line 6
if robot.docked() then
	while robot.charging() do
		task.wait(1)
elseif robot.battery() then
	print("away")
end
