-- An on_stop that waits forever, in tasks that cannot be cancelled.
-- expect: done
for _ = 1, 10 do
	task.spawn(function()
		while true do
			pcall(task.wait, 100)
		end
	end)
end
script.on_stop(function()
	while true do
		pcall(task.wait, 100)
	end
end)
task.wait(0.01)
script.stop(("very long "):rep(100))
