-- spykee lesson 2: sounds
-- A doorbell: three beeps, one a second, and a laugh after the last one.

for beep = 1, 3 do
	robot.play("bip_2")
	task.wait(1)
end
robot.play("laugh")
