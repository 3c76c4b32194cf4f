-- An event that does not exist.
-- expect: check 3: robot.on: unknown event 'battery_lo'; did you mean 'battery_low'?
robot.on("battery_lo", function()
	print("low")
end)
