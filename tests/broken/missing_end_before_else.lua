-- An if without its end, before the else of the if around it.
-- expect: check 4: the `if` that begins here has no `end`: it is missing before line 6
if robot.docked() then
	if robot.charging() then
		print("charging")
else
	print("away")
end
print("done")
