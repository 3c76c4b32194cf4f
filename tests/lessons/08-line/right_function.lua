-- right
local last = 0

local function steer(offset)
	return -1.3 * offset
end

local function search()
	if last >= 0 then
		robot.drive(0, -0.5)
	else
		robot.drive(0, 0.5)
	end
end

robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if not line then
		search()
		return
	end
	last = line.offset
	robot.drive(0.11, steer(last))
end)
