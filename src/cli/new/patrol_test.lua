-- What must become true of {{NAME}}.lua. Try it:  spykee test
-- Each scenario is played in virtual time, with every seed from 1 to `seeds`.

scenario("drives its square and hits nothing", { battery = 80, seeds = 3, limit = 60 }, function(sim)
	sim:run("{{NAME}}.lua")
	sim:wait(30)
	expect(sim:distance() > 1.5, `it drove {math.round(sim:distance() * 100)} cm only`)
	expect(sim:collisions() == 0, "it ran into something")
end)

scenario("is taken home when the battery runs low", { battery = 21, limit = 300 }, function(sim)
	sim:run("{{NAME}}.lua")
	expect(sim:wait_until(function() return sim:charging() end, 200), "it did not come home")
end)
