-- Switches streams on and off as fast as possible.
-- expect: done
local begun = task.now()
while task.now() - begun < 0.2 do
	for _ = 1, 100 do
		for _, name in { "video", "audio_in", "audio_out" } do
			pcall(robot.stream, name, true)
			pcall(robot.stream, name, false)
		end
	end
	task.wait()
end
