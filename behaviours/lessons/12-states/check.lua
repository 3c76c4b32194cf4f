-- Lesson 12: asleep, awake, happy.

local function laughs(sim)
	local count = 0
	for _, sound in sim:sounds() do
		if sound.name == "laugh" then
			count += 1
		end
	end
	return count
end

local function wake(sim, ball)
	-- This world is quiet.
	sim:place({ x = 1.2, y = 1.25, heading = 0 })
	sim:place_ball(1, ball)
	local heading = sim:pose().heading
	sim:run()
	sim:wait(5)
	expect(not sim:leds().flash, "It is awake although it was quiet: it should begin asleep.")
	expect(math.abs(sim:pose().heading - heading) < 0.1, "It turns although it is asleep.")
	sim:noise(-12, 0.5)
	expect(sim:wait_until(function() return sim:leds().flash end, 5), "A noise does not wake it: awake, its flash is on. A state machine starts with :run().")
	local turns = sim:wait_until(function() return math.abs(sim:pose().heading - heading) > 0.3 end, 6)
	expect(turns, "It is awake, but does not turn to look for the ball.")
end

local function sleeps(sim, seconds, words)
	expect(sim:wait_until(function() return not sim:leds().flash end, seconds), words)
	sim:wait(5)
	local heading = sim:pose().heading
	sim:wait(4)
	expect(math.abs(sim:pose().heading - heading) < 0.1 and not sim:leds().flash, "It fell asleep and woke up again by itself: did its own laugh wake it?")
end

scenario("It finds the ball, laughs and sleeps", { world = "playpen", points = 6, seeds = 2, limit = 120 }, function(sim)
	wake(sim, { x = 0.5, y = 2.1 })
	expect(sim:wait_until(function() return laughs(sim) > 0 end, 28), "It was awake and turned, but did not laugh when the ball was in sight.")
	sleeps(sim, 6, "It has laughed, but does not fall asleep: its flash is still on.")
	expect(laughs(sim) == 1, `It laughed {laughs(sim)} times: once is enough. Did its own laugh wake it?`)
end)

scenario("Without a ball it gives up", { world = "playpen", points = 4, seeds = 2, limit = 120 }, function(sim)
	wake(sim, { x = 50, y = 50 })
	sim:wait(15)
	expect(sim:leds().flash, "It gave up too early: it should look for the ball for 30 seconds.")
	sleeps(sim, 30, "There is no ball, but after 30 seconds it does not fall asleep.")
	expect(laughs(sim) == 0, "It laughed although there was no ball.")
end)
