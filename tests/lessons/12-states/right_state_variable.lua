-- right
local state = "asleep"
local woken = 0

robot.on("noise", function()
	if state == "asleep" then
		state = "awake"
		woken = task.now()
	end
end)

while true do
	if state == "asleep" then
		robot.led("flash", false)
		robot.stop()
		task.wait(0.1)
	elseif state == "awake" then
		robot.led("flash", true)
		robot.drive(0, 0.6)
		local frame = robot.wait_frame(1)
		if frame and frame:find_blobs("red", { pixels_threshold = 40 })[1] then
			state = "happy"
		elseif task.now() - woken > 30 then
			state = "asleep"
		end
	else
		robot.stop()
		robot.led("flash", false)
		robot.play("laugh")
		task.wait(4)
		state = "asleep"
	end
end
