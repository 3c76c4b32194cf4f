-- A code that no call answers.
-- expect: check 4: no code is called 'dockd'; did you mean 'docked'?
local ok, code = robot.move(40, 40, 1)
if not ok and code == "dockd" then
	robot.undock()
end
