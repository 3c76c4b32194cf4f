-- wrong: It does not get round the first bend|It has lost the line|It does not follow the line at all|it does not turn right|When the line is lost it stands still
robot.forward(1.6)
for bend = 1, 4 do
	robot.turn(math.rad(90))
	robot.forward(1.2)
end
