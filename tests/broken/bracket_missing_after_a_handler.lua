-- A handler whose call is not closed.
-- expect: check 7: after this `end`, the '(' of line 4 is still open
-- help: write end)
robot.on("battery", function(battery)
	print(battery.percent)
	robot.move(30, 30, 1)
end
print("ready")
