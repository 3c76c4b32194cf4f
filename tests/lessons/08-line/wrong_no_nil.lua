-- wrong: find_line returns nil then
local last = 0
robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	last = line.offset
	robot.drive(0.12, -1.5 * last)
end)
