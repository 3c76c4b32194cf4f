-- Scenarios: what {{NAME}}.lua must achieve. Try it:  spykee test
-- Each scenario runs in virtual time, with every seed from 1 to `seeds`.

scenario("ends by itself and hits nothing", { seeds = 3, limit = 60 }, function(sim)
	sim:run("{{NAME}}.lua")
	expect(sim:wait_until(function() return sim:ended() end, 30), "it did not end")
	expect(sim:collisions() == 0, "it ran into something")
end)
