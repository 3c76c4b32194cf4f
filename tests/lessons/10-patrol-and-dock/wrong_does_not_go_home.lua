-- wrong: but has not come home
local floor = require("@spykee/floor")
floor.leave_station()
for leg = 1, 3 do
	robot.forward(0.4)
	local frame = robot.wait_frame(2)
	if frame then
		frame:save(`leg-{leg}.jpg`)
	end
	robot.turn(math.rad(120))
end
task.wait(1000)
