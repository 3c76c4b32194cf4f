-- wrong: Its lights went on although it was quiet
while true do
	robot.led("all", true)
	robot.turn(math.rad(360))
	robot.led("all", false)
	task.wait(5)
end
