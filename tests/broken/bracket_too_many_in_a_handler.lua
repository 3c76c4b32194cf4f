-- A bracket too many, in a handler that has its end.
-- expect: check 4: a value is missing after `)`
robot.on("docked", function()
	print("home"))
end)
