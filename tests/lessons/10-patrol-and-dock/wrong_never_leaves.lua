-- wrong: It does not leave its station
while true do
	for leg = 1, 3 do
		robot.forward(0.4)
		local frame = robot.wait_frame(2)
		if frame then
			frame:save(`leg-{leg}.jpg`)
		end
		robot.turn(math.rad(120))
	end
	robot.dock()
	task.wait(5)
end
