-- Sends sounds and speech as fast as possible.
-- expect: done
robot.stream("audio_out", true)
local second = buffer.create(32000)
local begun = task.now()
while task.now() - begun < 0.2 do
	for _ = 1, 20 do
		pcall(robot.say, second)
		pcall(robot.play, "bomb")
		pcall(robot.stop_sound)
	end
	task.wait()
end
