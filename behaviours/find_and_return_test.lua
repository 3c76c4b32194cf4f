-- Finds the object and comes home.

local function finds(sim, colour, seconds)
	sim:run({ "find_and_return.lua", params = { colour = colour } })
	expect(sim:wait_until(function() return sim:ended() end, seconds), "it ends")
	expect(#sim:log(`found {colour}`) == 1 and sim:photos() == 1)
	expect(sim:ended() == "done" and sim:docked() and sim:charging())
end

scenario("finds the ball in the pen and comes home", { world = "playpen" }, function(sim)
	sim:place_ball(1, { x = 1.5 + 1.1 * math.random(), y = 0.6 + 1.3 * math.random() })
	finds(sim, "red", 120)
end)

scenario("finds the blue post in the gallery and comes home", { world = "gallery", fps = 8, limit = 400 }, function(sim)
	sim:place({ x = 1 + 2 * math.random(), y = 0.8 + 1.2 * math.random(), heading = 2 * math.pi * math.random() })
	finds(sim, "blue", 390)
end)

scenario("finds the ball two rooms away and comes home", { world = "hall", fps = 8, limit = 480 }, function(sim)
	sim:place({ x = 1 + 1.4 * math.random(), y = 1 + 3 * math.random(), heading = 2 * math.pi * math.random() })
	finds(sim, "red", 470)
end)

scenario("comes home and reports an error when there is nothing", { world = "playpen", may_fail = true }, function(sim)
	sim:run({ "find_and_return.lua", params = { colour = "magenta", places = 2 } })
	expect(sim:wait_until(function() return sim:ended() end, 300), "it ends")
	expect(sim:docked() and sim:ended() == "error" and #sim:log("nothing magenta") > 0)
end)
