-- right
local melody = {
	{ sound = "bip_2", pause = 1 },
	{ sound = "bip_2", pause = 1 },
	{ sound = "bip_2", pause = 1.2 },
	{ sound = "laugh", pause = 0 },
}
for _, step in melody do
	robot.play(step.sound)
	task.wait(step.pause)
end
