-- right
for _, power in { 40, -40 } do
	robot.move(power, power, 2)
	task.wait(1)
end
