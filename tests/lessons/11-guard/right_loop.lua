-- right
local detector = vision.motion()
local last = -10
while true do
	local frame = robot.wait_frame(1)
	local motion = frame and detector:update(frame)
	if motion and motion.pixels > 0 and task.now() - last >= 10 then
		last = task.now()
		frame:save("intruder.jpg")
		robot.play("alarm")
	end
end
