-- right
robot.led("left", true)
task.delay(1, function()
	robot.led("left", false)
	robot.led("right", true)
end)
task.delay(2, function()
	robot.led("right", false)
end)
