-- right
local floor = require("@spykee/floor")
local number = 0

local function photograph()
	local frame = robot.wait_frame(2)
	if frame == nil then
		log.warn("no picture")
		return
	end
	number += 1
	frame:save(`photo-{number % 12}.jpg`)
end

local function leg()
	robot.forward(0.4)
	photograph()
	robot.turn(2 * math.pi / 3)
end

local function is_full()
	local battery = robot.battery()
	return battery ~= nil and (battery.percent or 0) >= 60
end

while true do
	while robot.docked() and not floor.leave_station() do
		task.wait(5)
	end
	leg()
	leg()
	leg()
	robot.dock()
	while not is_full() do
		task.wait(2)
	end
end
