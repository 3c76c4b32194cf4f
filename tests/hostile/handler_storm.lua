-- Registers the maximum of handlers, each of which causes the events that it handles.
-- expect: error
for _ = 1, 60 do
	robot.on("sound_finished", function()
		robot.play("alarm")
		robot.stop_sound()
	end)
end
robot.play("music")
robot.stop_sound()
task.wait(0.2)
while true do
	robot.on("sound_finished", function() end)
end
