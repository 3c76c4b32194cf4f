-- Switches lights as fast as possible, in many tasks that each wait a little.
-- expect: done
for _ = 1, 20 do
	task.spawn(function()
		for turn = 1, 1e9 do
			pcall(robot.led, "flash", turn % 2 == 0)
			if turn % 20 == 0 then
				task.wait()
			end
		end
	end)
end
task.wait(0.2)
script.stop("enough")
