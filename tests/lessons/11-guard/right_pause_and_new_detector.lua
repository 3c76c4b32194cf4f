-- right
while true do
	local detector = vision.motion()
	local seen = false
	while not seen do
		local frame = robot.wait_frame(2)
		local motion = frame and detector:update(frame)
		if motion and #motion.blobs > 0 then
			seen = true
			robot.play("alarm")
			frame:save("intruder.jpg")
		end
	end
	task.wait(10)
end
