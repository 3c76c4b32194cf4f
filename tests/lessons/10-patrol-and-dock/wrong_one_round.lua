-- wrong: did not start again
local function round()
	robot.undock()
	robot.turn(math.rad(180))
	for leg = 1, 3 do
		robot.forward(0.4)
		local frame = robot.wait_frame(2)
		if frame then
			frame:save(`leg-{leg}.jpg`)
		end
		robot.turn(math.rad(120))
	end
	robot.dock()
end

local function charge()
	local battery = robot.battery()
	while battery and battery.percent < 60 do
		task.wait(5)
		battery = robot.battery()
	end
end

round()
charge()
