-- An if with an elseif, without its end, at the end of the file.
-- expect: check 3: the `if` that begins here has no `end`: it is missing at the end of the file
if robot.docked() then
	print("home")
elseif robot.battery() then
	print(if robot.charging() then "charging" else "away")
