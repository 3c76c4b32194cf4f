-- wrong: After the first noise its lights did not go off again
robot.on("noise", function()
	robot.led("all", true)
	robot.turn(math.rad(360))
end)
