-- wrong: At the first noise its lights did not go on
robot.on("noise", function()
	robot.turn(math.rad(360))
end)
