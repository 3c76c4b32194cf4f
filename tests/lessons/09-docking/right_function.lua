-- right
local floor = require("@spykee/floor")

local function report(ok)
	if ok then
		robot.play("bip_2")
	else
		robot.play("alarm")
	end
end

if floor.leave_station() then
	robot.forward(0.5)
	local ok = robot.dock()
	report(ok)
end
