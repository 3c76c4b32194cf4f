-- NaN, infinities and the largest numbers as arguments of every function that takes a number.
-- expect: done
for _, n in { 0 / 0, 1 / 0, -1 / 0, 2 ^ 53, -2 ^ 63, 1e308, 5e-324, -0 } do
	for _, call in {
		robot.move, robot.drive, robot.forward, robot.turn, robot.volume,
		task.delay, task.every, robot.wait_frame, task.timeout,
	} do
		pcall(task.timeout, 0.001, call, n, n, n)
		pcall(task.timeout, 0.001, call, n, function() end, n)
	end
	pcall(task.timeout, 0.001, robot.dock, { timeout = n, retries = n, charge_timeout = n })
	pcall(task.timeout, 0.001, robot.blink, "flash", { on = n, off = n, count = n })
	pcall(robot.on, "frame", print, { rate = n })
end
script.stop("enough")
