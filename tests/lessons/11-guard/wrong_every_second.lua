-- wrong: There was an alarm although nothing had moved
robot.on("frame", function(frame)
	robot.play("alarm")
	frame:save("intruder.jpg")
end, { rate = 1 })
