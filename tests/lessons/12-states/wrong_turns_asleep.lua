-- wrong: It turns although it is asleep
robot.drive(0, 0.6)
while true do
	robot.wait_for("noise")
	robot.led("flash", true)
	local woken = task.now()
	local found = false
	while not found and task.now() - woken < 30 do
		local frame = robot.wait_frame(1)
		found = frame ~= nil and #frame:find_blobs("red", { pixels_threshold = 40 }) > 0
	end
	robot.led("flash", false)
	if found then
		robot.play("laugh")
		task.wait(4)
	end
end
