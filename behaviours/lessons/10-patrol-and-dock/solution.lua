-- spykee lesson 10: patrol and dock
-- A patrol for the whole day: three legs with a photograph each, home, charge to 60 %, repeat.

local floor = require("@spykee/floor")

local function photograph(name)
	local frame = robot.wait_frame(2)
	if frame then
		frame:save(name)
	end
end

local function round()
	if robot.docked() and not floor.leave_station() then
		return task.wait(5) -- at an unknown level it may have to charge longer
	end
	for leg = 1, 3 do
		robot.forward(0.4)
		photograph(`leg-{leg}.jpg`)
		robot.turn(math.rad(120))
	end
	robot.dock()
end

local function charge()
	local battery = robot.battery()
	while battery and (battery.percent or 100) < 60 do
		task.wait(5)
		battery = robot.battery()
	end
end

while true do
	round()
	charge()
end
