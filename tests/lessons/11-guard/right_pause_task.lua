-- right
local detector = vision.motion()
local pause = 0
task.every(1, function()
	pause = math.max(0, pause - 1)
end)
robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion and #motion.blobs > 0 and pause == 0 then
		pause = 11
		robot.play("alarm")
		frame:save("intruder.jpg")
	end
end)
