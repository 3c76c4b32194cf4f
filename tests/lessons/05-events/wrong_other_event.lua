-- wrong: although it was quiet
robot.on("frame", function()
	robot.led("all", true)
	robot.turn(math.rad(360))
	robot.led("all", false)
end)
