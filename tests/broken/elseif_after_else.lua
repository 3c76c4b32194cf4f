-- An elseif after the else.
-- expect: check 7: this `elseif` comes after the `else` on line 5
if robot.docked() then
	print("home")
else
	print("away")
elseif robot.charging() then
	print("charging")
end
