-- An if without its end.
-- expect: check 4: the `if` that begins here has no `end`
local function look()
	if robot.docked() then
		print("home")
end
look()
