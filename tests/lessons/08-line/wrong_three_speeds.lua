-- wrong: let it turn in proportion
local last = 0
robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line then
		last = line.offset
		local turn = 0
		if math.abs(last) > 0.5 then
			turn = 1
		elseif math.abs(last) > 0.15 then
			turn = 0.5
		end
		robot.drive(0.1, if last > 0 then -turn else turn)
	else
		robot.drive(0, if last > 0 then -0.6 else 0.6)
	end
end)
