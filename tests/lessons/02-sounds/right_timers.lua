-- right
for second = 0, 2 do
	task.delay(second, robot.play, "bip_2")
end
task.delay(3, robot.play, "laugh")
