-- wrong: It started again at 50 percent
local floor = require("@spykee/floor")
while true do
	floor.leave_station()
	for leg = 1, 3 do
		robot.forward(0.4)
		local frame = robot.wait_frame(2)
		if frame then
			frame:save(`leg-{leg}.jpg`)
		end
		robot.turn(math.rad(120))
	end
	robot.dock()
	if robot.battery().percent < 60 then
		task.wait(5)
	end
end
