-- The lights are on at night, off by day, and do not flicker.

local function lit(sim)
	return function()
		return sim:leds().left
	end
end

local function dark(sim)
	return function()
		return not sim:leds().left
	end
end

scenario("shines when the lamp goes out and stops when it comes on", { world = "night", fps = 4 }, function(sim)
	sim:place({ x = 1.2 + 0.8 * math.random(), y = 1.3 + 1.2 * math.random(), heading = 2 * math.pi * math.random() })
	sim:run("night_light.lua")
	sim:wait(18)
	expect(not lit(sim)(), "the lamp is on: it is day")
	expect(sim:wait_until(lit(sim), 25), "the lamp is out: it is night")
	sim:wait(90 - sim:time())
	expect(sim:wait_until(dark(sim), 15), "the lamp is on again: it is day")
	expect(#sim:log("night ") == 1 and #sim:log("day") == 1, `no flicker: {#sim:log("night ")} {#sim:log("day")}`)
end)

scenario("is off all day and on when it gets dark", { battery = 90, fps = 4 }, function(sim)
	sim:place({ x = 1 + 2 * math.random(), y = 1.5 + 2 * math.random(), heading = 2 * math.pi * math.random() })
	sim:run("night_light.lua")
	sim:wait(30)
	expect(#sim:log("night ") == 0, "it is not night in a bright room")
	sim:light(0.05)
	expect(sim:wait_until(lit(sim), 25), "it is night in a dark room")
end)

scenario("continues to shine after a restart in the dark", { battery = 90, fps = 4 }, function(sim)
	sim:light(0.05)
	sim:run("night_light.lua")
	expect(sim:wait_until(lit(sim), 25))
	sim:wait(2)
	sim:stop()
	sim:run("night_light.lua")
	sim:wait(2)
	expect(lit(sim)(), "the lights are on at once, before the first look")
	sim:wait(30)
	expect(#sim:log("night ") == 1, "it is the same night")
end)
