-- right
while true do
	robot.wait_for("noise")
	robot.led("flash", true)
	robot.move(50, -50, math.pi * 0.24 / 0.225)
	robot.led("flash", false)
end
