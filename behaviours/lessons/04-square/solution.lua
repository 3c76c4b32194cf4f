-- spykee lesson 4: a square
-- A square with sides of 40 centimetres, to the left, back to where it began.

for side = 1, 4 do
	robot.forward(0.4)
	robot.turn(math.rad(90))
end
