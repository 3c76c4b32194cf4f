-- Lesson 1: a turn signal.

local OTHER = { left = "right", right = "left" }

-- Checks that one light is on for about a second, alone.
local function signals(sim, name)
	expect(sim:wait_until(function() return sim:leds()[name] end, 8), `The {name} light never went on, or only for a moment: easy.light("{name}", "on") switches it on, easy.wait(1) waits for a second.`)
	expect(not sim:leds()[OTHER[name]], `When the {name} light went on, the {OTHER[name]} one was on too: they should go on one after the other.`)
	local since = sim:time()
	expect(sim:wait_until(function() return not sim:leds()[name] end, 5), `The {name} light went on, but was not off again five seconds later: easy.light("{name}", "off") switches it off.`)
	local seconds = sim:time() - since
	expect(seconds > 0.7 and seconds < 1.5, string.format("The %s light was on for %.1f seconds: it should be one second.", name, seconds))
end

scenario("The left light signals first", { world = "yard", points = 4, limit = 30 }, function(sim)
	sim:run()
	sim:wait_until(function() return sim:leds().left or sim:leds().right end, 8)
	expect(not sim:leds().right or sim:leds().left, "The right light went on first: start with the left one.")
	signals(sim, "left")
end)

scenario("The right light follows", { world = "yard", points = 4, limit = 30 }, function(sim)
	sim:run()
	signals(sim, "right")
end)

scenario("At the end all lights are off", { world = "yard", points = 2, limit = 40 }, function(sim)
	sim:run()
	local lit = sim:wait_until(function() return sim:leds().left or sim:leds().right end, 8)
	expect(lit, "No light ever went on, or only for a moment.")
	expect(sim:wait_until(function() return sim:ended() end, 20), "The script does not end: after the two signals there is nothing left to do.")
	local leds = sim:leds()
	for _, name in { "left", "right", "flash" } do
		expect(not leds[name], `At the end the {name} light is still on.`)
	end
end)
