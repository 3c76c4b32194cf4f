-- right
local floor = require("@spykee/floor")

local function round()
	floor.leave_station()
	for _, name in { "first", "second", "third" } do
		robot.forward(0.4)
		task.wait(0.5)
		local frame = robot.wait_frame(2)
		if frame then
			frame:save(name .. ".jpg")
		end
		robot.turn(math.rad(-120))
	end
	local ok, code = robot.dock()
	if not ok then
		log.warn(`not home: {code}`)
	end
end

while true do
	round()
	local battery = robot.battery()
	while battery.percent < 60 do
		task.wait(3)
		battery = robot.battery()
	end
end
