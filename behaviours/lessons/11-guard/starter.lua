-- spykee lesson 11: the guard
-- Watches; sounds the alarm and saves a photograph when something moves.
-- Here it sounds the alarm once a second, whatever it sees.

robot.on("frame", function(frame)
	robot.play("alarm")
end, { rate = 1 })
