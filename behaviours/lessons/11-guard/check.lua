-- Lesson 11: a guard.

local function alarms(sim)
	local times = {}
	for _, sound in sim:sounds() do
		if sound.name == "alarm" then
			table.insert(times, sound.time)
		end
	end
	return times
end

-- The ball lies still, out of sight or, with `y`, in sight.
local function watch(sim, y)
	sim:place_ball(1, { x = 2.4, y = y or 2.2 })
	sim:run()
	sim:wait(6)
	expect(#alarms(sim) == 0, "There was an alarm although nothing had moved.")
end

-- Rolls a ball through the picture. Returns whether there was an alarm.
local function roll(sim, from, to)
	local before = #alarms(sim)
	for step = 0, 12 do
		sim:place_ball(1, { x = 2.4, y = from + (to - from) * step / 12 })
		sim:wait(0.15)
	end
	return sim:wait_until(function() return #alarms(sim) > before end, 3)
end

scenario("Something moves", { world = "yard", points = 4, seeds = 2, limit = 40 }, function(sim)
	watch(sim)
	expect(roll(sim, 2.2, 0.9), "A ball rolled by, but there was no alarm.")
	sim:wait(2)
	expect(sim:photos() > 0, "A ball rolled by, but there is no photograph: frame:save saves one.")
end)

scenario("One alarm in ten seconds, then another", { world = "yard", points = 3, seeds = 2, limit = 60 }, function(sim)
	watch(sim)
	expect(roll(sim, 2.2, 0.9), "A ball rolled by, but there was no alarm.")
	roll(sim, 0.9, 2.2)
	expect(#alarms(sim) == 1, "There was more than one alarm within ten seconds.")
	sim:wait(10)
	expect(roll(sim, 2.2, 0.9), "A ball rolled by after the ten seconds, but there was no second alarm.")
end)

scenario("A lamp is not an intruder", { world = "yard", points = 3, seeds = 2, limit = 60 }, function(sim)
	watch(sim, 1.5)
	sim:light(0.6)
	sim:wait(4)
	sim:light(1)
	sim:wait(4)
	expect(#alarms(sim) == 0, "A lamp was switched, which is no reason for an alarm: look at the detector's blobs.")
	expect(roll(sim, 2.2, 0.9), "A ball rolled by, but there was no alarm.")
end)
