-- spykee lesson 4: a square
-- A square with sides of 40 centimetres, to the left, back to where it began.
-- Here are one side and one corner.

robot.forward(0.4)
robot.turn(math.rad(90))
