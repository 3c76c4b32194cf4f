-- Lesson 5: wakes up at noises.

local function awake(sim)
	local leds = sim:leds()
	return leds.left or leds.right or leds.flash
end

-- In a world where it is quiet.
local function begin(sim)
	sim:place({ x = 1.2, y = 1.25, heading = 0 })
	sim:run()
end

local function wakes_up(sim, which)
	sim:noise(-12, 0.5)
	expect(sim:wait_until(function() return awake(sim) end, 5), `At the {which} noise its lights did not go on.`)
end

scenario("It sleeps until it hears something", { world = "playpen", points = 4, limit = 40 }, function(sim)
	begin(sim)
	for _ = 1, 16 do
		sim:wait(0.5)
		expect(not awake(sim), "Its lights went on although it was quiet.")
		expect(math.abs(sim:pose().heading) < 0.1, "It turned although it was quiet.")
	end
	wakes_up(sim, "first")
end)

scenario("It turns round once and sleeps again, each time", { world = "playpen", points = 6, seeds = 2, limit = 120 }, function(sim)
	begin(sim)
	for _, which in { "first", "second" } do
		sim:wait(4)
		wakes_up(sim, which)
		local turned = sim:wait_until(function() return math.abs(sim:pose().heading) > 2 end, 15)
		expect(turned, `At the {which} noise it did not turn round.`)
		local dark = sim:wait_until(function() return not awake(sim) end, 20)
		expect(dark, `After the {which} noise its lights did not go off again.`)
		local heading = sim:pose().heading
		expect(math.abs(heading) < 0.9, `After the {which} noise it did not turn all the way round: math.rad(360) is once round.`)
	end
	expect(sim:distance() < 2, "It drove away: it should only turn on the spot.")
end)
