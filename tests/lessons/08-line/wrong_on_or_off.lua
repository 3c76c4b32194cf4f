-- wrong: let it turn in proportion
local last = 0
robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line then
		last = line.offset
		local turn = 0
		if last > 0.3 then
			turn = -0.8
		elseif last < -0.3 then
			turn = 0.8
		end
		robot.drive(0.1, turn)
	else
		robot.drive(0, if last > 0 then -0.6 else 0.6)
	end
end)
