-- wrong: After the first noise its lights did not go off again
robot.on("noise", function()
	robot.led("all", true)
	robot.turn(360)
	robot.led("all", false)
end)
