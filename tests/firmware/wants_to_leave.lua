-- Tries again and again to leave its station.
while not robot.undock() do
	task.wait(2)
end
