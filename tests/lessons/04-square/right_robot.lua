-- right
for side = 1, 4 do
	robot.forward(0.4)
	robot.turn(math.rad(90))
end
