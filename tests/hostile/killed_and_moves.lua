-- After exceeding its budget, tries to drive in its last pcall, and in the handler of its last xpcall.
-- expect: cpu
local function drive()
	while true do
		pcall(robot.move, 90, 90)
		pcall(robot.drive, 1, 0)
		pcall(robot.led, "flash", true)
	end
end
while true do
	xpcall(function()
		while true do
		end
	end, drive)
	pcall(drive)
end
