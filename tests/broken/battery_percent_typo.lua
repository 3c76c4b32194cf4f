-- A letter swapped in a field.
-- expect: check 5: a Battery has no 'precent'; did you mean 'percent'?
local battery = robot.battery()
if battery then
	print(battery.precent)
end
