-- 140 percent, computed.
-- expect: run 4: robot.move: left must be between -100 and 100, got 140
local function go(speed)
	robot.move(speed * 2, 50)
end
go(70)
