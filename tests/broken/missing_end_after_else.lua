-- An if with an else, without its end.
-- expect: check 4: the `if` that begins here has no `end`: it is missing before line 8
local function look()
	if robot.docked() then
		print("home")
	else
		print("away")
end
look()
