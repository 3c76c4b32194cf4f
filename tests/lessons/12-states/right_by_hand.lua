-- right
local function see_ball()
	local frame = robot.wait_frame(1)
	return frame and frame:find_blobs("red", { pixels_threshold = 40 })[1]
end

while true do
	robot.wait_for("noise")
	robot.led("flash", true)
	robot.drive(0, 0.6)
	local woken = task.now()
	local found = false
	while not found and task.now() - woken < 30 do
		found = see_ball() ~= nil
	end
	robot.stop()
	robot.led("flash", false)
	if found then
		robot.play("laugh")
		task.wait(4)
	end
end
