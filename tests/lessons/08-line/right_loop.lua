-- right
local last = 0
while true do
	local frame = robot.wait_frame(1)
	local line = frame and frame:find_line("black", { roi = { 0, 190, 320, 50 } })
	if line then
		last = line.offset
		robot.drive(0.1, -1.2 * last)
	elseif last < 0 then
		robot.drive(0, 0.6)
	else
		robot.drive(0, -0.6)
	end
end
