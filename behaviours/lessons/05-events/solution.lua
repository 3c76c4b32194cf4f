-- spykee lesson 5: listening
-- A robot that wakes up at each noise: lights on, once round, lights off.

robot.on("noise", function()
	robot.led("all", true)
	robot.turn(math.rad(360))
	robot.led("all", false)
end)
