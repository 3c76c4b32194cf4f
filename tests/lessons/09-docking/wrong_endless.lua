-- wrong: The script does not end
local floor = require("@spykee/floor")
while true do
	floor.leave_station()
	robot.forward(0.5)
	local ok = robot.dock()
	robot.play(if ok then "bip_2" else "alarm")
	task.wait(1)
end
