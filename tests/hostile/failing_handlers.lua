-- Handlers that fail each time, in many places.
-- expect: error
for at = 1, 20 do
	robot.on("audio", function()
		error("place " .. at)
	end)
end
task.wait(30)
