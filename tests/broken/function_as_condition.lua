-- The parentheses are missing: a function is always true.
-- expect: check 3: robot.docked is a function here, which is always true
if robot.docked then
	robot.undock()
end
