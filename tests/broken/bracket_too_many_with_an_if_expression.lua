-- A bracket too many; an `else if` in an expression has no end.
-- expect: check 5: a value is missing after `)`
local name = if robot.docked() then "home" else if robot.battery() then "away" else "unknown"
robot.on("docked", function()
	print(name))
end)
