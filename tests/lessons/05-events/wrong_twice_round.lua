-- wrong: times round: once is wanted
robot.on("noise", function()
	robot.led("all", true)
	robot.turn(math.rad(720))
	robot.led("all", false)
end)
