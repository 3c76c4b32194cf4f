-- Drives in on_stop, with every call that moves.
-- expect: done
script.on_stop(function()
	local calls = {
		function() robot.move(90, 90) end,
		function() robot.move(90, 90, 9) end,
		function() robot.drive(1, 0) end,
		function() robot.forward(3) end,
		function() robot.turn(3) end,
		function() robot.dock() end,
		function() robot.undock() end,
		function() task.spawn(robot.move, 90, 90) end,
		function() task.delay(0.01, robot.move, 90, 90) end,
		function() robot.on("engine", function() robot.move(90, 90) end) end,
	}
	for _ = 1, 3 do
		for _, call in calls do
			pcall(call)
			pcall(coroutine.wrap(call))
		end
		task.wait(0.02)
	end
end)
