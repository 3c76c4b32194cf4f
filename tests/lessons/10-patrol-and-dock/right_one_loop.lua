-- right
local floor = require("@spykee/floor")
while true do
	if robot.docked() then
		floor.leave_station()
	end
	for leg = 1, 3 do
		robot.forward(0.4)
		local frame = robot.wait_frame(2)
		if frame then
			frame:save("leg-" .. leg .. ".jpg")
		end
		robot.turn(math.rad(120))
	end
	robot.dock()
	repeat
		task.wait(5)
	until robot.battery().percent >= 60
end
