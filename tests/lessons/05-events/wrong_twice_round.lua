-- wrong: times round: it should be once
robot.on("noise", function()
	robot.led("all", true)
	robot.turn(math.rad(720))
	robot.led("all", false)
end)
