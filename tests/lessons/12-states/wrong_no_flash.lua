-- wrong: A noise does not wake it
while true do
	robot.wait_for("noise")
	robot.drive(0, 0.6)
	local woken = task.now()
	local found = false
	while not found and task.now() - woken < 30 do
		local frame = robot.wait_frame(1)
		found = frame ~= nil and #frame:find_blobs("red", { pixels_threshold = 40 }) > 0
	end
	robot.stop()
	if found then
		robot.play("laugh")
		task.wait(4)
	end
end
