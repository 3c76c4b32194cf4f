-- wrong: easy.left takes degrees, robot.turn radians
for side = 1, 4 do
	robot.forward(0.4)
	robot.turn(90)
end
