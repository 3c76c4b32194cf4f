-- wrong: At the first noise it did not turn round
robot.on("noise", function()
	robot.led("all", true)
	task.wait(2)
	robot.led("all", false)
end)
