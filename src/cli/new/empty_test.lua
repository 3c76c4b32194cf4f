-- What must become true, as scenarios. This version of spykee has no command yet that runs them.
-- Each is meant for a simulated world, much faster than real time, once for each seed.

scenario("hits nothing", { battery = 80, seeds = 3, limit = 60 }, function(sim)
	sim:run("{{NAME}}.lua")
	expect(sim:collisions() == 0)
end)
