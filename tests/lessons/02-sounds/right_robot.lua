-- right
for beep = 1, 3 do
	robot.play("bip_2")
	task.wait(1)
end
robot.play("laugh")
