-- wrong: It laughed although there was no ball
while true do
	robot.wait_for("noise")
	robot.led("flash", true)
	robot.drive(0, 0.6)
	local woken = task.now()
	local found = false
	while not found and task.now() - woken < 30 do
		local frame = robot.wait_frame(1)
		found = frame ~= nil and #frame:find_blobs("red", { pixels_threshold = 40 }) > 0
	end
	robot.stop()
	robot.led("flash", false)
	robot.play("laugh")
	task.wait(4)
end
