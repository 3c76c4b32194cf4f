-- wrong: woke up again after the first noise
robot.on("noise", function()
	while true do
		robot.led("all", true)
		robot.turn(math.rad(360))
		robot.led("all", false)
		task.wait(1)
	end
end)
