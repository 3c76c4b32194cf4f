-- wrong: Its lights went on although it was quiet
while true do
	robot.wait_for("noise", 5)
	robot.led("all", true)
	robot.turn(math.rad(360))
	robot.led("all", false)
end
