-- right
local last = 0
robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line then
		last = line.offset
		robot.move(50 + 50 * last, 50 - 50 * last)
	elseif last > 0 then
		robot.move(35, -35)
	else
		robot.move(-35, 35)
	end
end)
