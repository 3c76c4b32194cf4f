-- Stops itself and drives on.
-- expect: done
while true do
	pcall(script.stop, "now")
	pcall(robot.move, 90, 90)
end
