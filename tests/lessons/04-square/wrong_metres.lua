-- wrong: The first side is far too long
for side = 1, 4 do
	robot.forward(40)
	robot.turn(math.rad(90))
end
