-- wrong: At the first noise its lights did not go on
robot.on("noise", function()
	print("lights on")
	robot.turn(math.rad(360))
	print("lights off")
end)
