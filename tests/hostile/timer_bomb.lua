-- Endless timers, each of which creates timers.
-- expect: error cpu memory
local function tick()
	while true do
		task.delay(0.001, tick)
		task.every(0.001, tick)
	end
end
tick()
