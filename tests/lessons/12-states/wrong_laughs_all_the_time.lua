-- wrong: It laughed 2 times|It laughed 3 times|It laughed 4 times
while true do
	robot.wait_for("noise")
	robot.led("flash", true)
	robot.drive(0, 0.6)
	local woken = task.now()
	local laughs = 0
	while laughs < 3 and task.now() - woken < 30 do
		local frame = robot.wait_frame(1)
		if frame and frame:find_blobs("red", { pixels_threshold = 40 })[1] then
			robot.stop()
			robot.play("laugh")
			laughs += 1
			task.wait(1)
		end
	end
	robot.stop()
	robot.led("flash", false)
	task.wait(4)
end
