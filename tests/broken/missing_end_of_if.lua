-- An if without its end.
-- expect: check 4: the `if` that begins here has no `end`: it is missing before line 6
local function look()
	if robot.docked() then
		print("home")
end
look()
