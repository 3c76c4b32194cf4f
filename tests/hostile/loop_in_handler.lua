-- An event handler that never returns.
-- expect: cpu
robot.on("audio", function()
	while true do
	end
end)
task.wait(30)
