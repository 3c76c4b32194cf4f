-- wrong: At the first noise it did not turn round
robot.on("noise", function()
	robot.led("all", true)
	robot.forward(0.4)
	robot.led("all", false)
end)
