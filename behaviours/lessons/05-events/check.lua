-- Lesson 5: wakes up at noises.

local ROUND = 2 * math.pi

local function awake(sim)
	local leds = sim:leds()
	return leds.left or leds.right or leds.flash
end

-- Starts the script in a quiet world.
local function begin(sim)
	sim:place({ x = 1.2, y = 1.25, heading = 0 })
	sim:run()
end

local function wakes_up(sim, which)
	sim:noise(-12, 0.5)
	expect(sim:wait_until(function() return awake(sim) end, 5), `At the {which} noise its lights did not go on, or only for a moment.`)
end

-- Waits until `what()` is true. Returns whether that happened, and how far the robot turned
-- meanwhile, in radians.
local function turning_until(sim, what, seconds)
	local turned, heading = 0, sim:pose().heading
	local came = sim:wait_until(function()
		local by = sim:pose().heading - heading
		turned, heading = turned + math.atan2(math.sin(by), math.cos(by)), sim:pose().heading
		return what()
	end, seconds)
	return came, math.abs(turned)
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

scenario("It turns round once and sleeps again, after each noise", { world = "playpen", points = 6, seeds = 2, limit = 120 }, function(sim)
	begin(sim)
	for _, which in { "first", "second" } do
		sim:wait(4)
		wakes_up(sim, which)
		local dark, turned = turning_until(sim, function() return not awake(sim) end, 40)
		expect(dark, `After the {which} noise its lights did not go off again.`)
		expect(turned > 0.5, `At the {which} noise it did not turn round.`)
		expect(turned > ROUND - 0.9, `After the {which} noise it did not turn all the way round: math.rad(360) is once round.`)
		expect(turned < ROUND + 0.9, `After the {which} noise it turned {math.round(10 * turned / ROUND) / 10} times round: it should be once.`)
		local again, more = turning_until(sim, function() return awake(sim) end, 6)
		expect(not again and more < 0.5, `It woke up again after the {which} noise, although it was quiet.`)
	end
	expect(sim:distance() < 2, "It drove away: it should only turn on the spot.")
end)
