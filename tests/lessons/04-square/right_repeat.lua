-- right
local side = 1
repeat
	robot.forward(0.4)
	robot.turn(math.pi / 2)
	side += 1
until side > 4
