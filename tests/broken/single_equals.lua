-- A comparison with one sign.
-- expect: check 3: a single = sets a variable
if robot.docked() = true then
	print("home")
end
