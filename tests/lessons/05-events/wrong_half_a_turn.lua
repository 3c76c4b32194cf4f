-- wrong: it did not turn all the way round
robot.on("noise", function()
	robot.led("all", true)
	robot.turn(math.rad(180))
	robot.led("all", false)
end)
