-- wrong: At the second noise its lights did not go on
robot.once("noise", function()
	robot.led("all", true)
	robot.turn(math.rad(360))
	robot.led("all", false)
end)
task.wait(200)
