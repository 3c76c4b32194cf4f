-- Drives about without looking where it goes, camera on, and says when it is told that it is held.
robot.stream("video", true)
robot.wait_frame(5)
while true do
	local speed = 0.12 + 0.23 * math.random()
	local ok, code = robot.forward(0.5 + 3 * math.random(), speed)
	if code == "blocked" then
		log.info("blocked")
		robot.forward(-0.6, 0.2)
	elseif not ok then
		task.wait(1)
	end
	robot.turn(math.rad(math.random(70, 180)) * (if math.random() < 0.5 then 1 else -1))
end
