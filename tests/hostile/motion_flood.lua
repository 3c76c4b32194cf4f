-- Sends setpoints as fast as possible, from many tasks at once.
-- expect: cpu done
for task_number = 1, 20 do
	task.spawn(function()
		while true do
			for turn = 1, 20 do
				pcall(robot.move, turn - 10, task_number)
			end
			task.wait()
		end
	end)
end
task.wait(0.2)
script.stop("enough")
