-- The battery is a table.
-- expect: check 3: `robot.battery()` is a Battery: it cannot be compared with < or >
if robot.battery() < 30 then
	robot.dock()
end
