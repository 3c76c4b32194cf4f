-- wrong: or only for a moment|it did not turn round
robot.on("noise", function()
	robot.led("all", true)
	robot.led("all", false)
	robot.turn(math.rad(360))
end)
