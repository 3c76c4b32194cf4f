-- wrong: It came home without a photograph
local floor = require("@spykee/floor")
while true do
	floor.leave_station()
	for leg = 1, 3 do
		robot.forward(0.4)
		robot.turn(math.rad(120))
	end
	robot.dock()
	while robot.battery().percent < 60 do
		task.wait(5)
	end
end
