-- wrong: Its battery has reached 60 percent, but it did not start again
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
	while robot.battery().percent < 95 do
		task.wait(5)
	end
end
