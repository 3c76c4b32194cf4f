-- right
local function wake_up()
	robot.led("left", true)
	robot.led("right", true)
	robot.turn(2 * math.pi)
	robot.led("left", false)
	robot.led("right", false)
end

robot.on("noise", wake_up)
