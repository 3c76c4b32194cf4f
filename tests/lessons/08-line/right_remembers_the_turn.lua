-- right
local turn = 0.5
while true do
	local frame = robot.wait_frame(1)
	if frame then
		local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
		if line then
			turn = -1.4 * line.offset
			robot.drive(0.12, turn)
		elseif turn > 0 then
			robot.drive(0, 0.7)
		else
			robot.drive(0, -0.7)
		end
	end
end
