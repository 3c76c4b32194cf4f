-- Every place for a handler is taken, and each handler makes the events it listens to.
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
