-- What must become true, as scenarios. This version of spykee has no command yet that runs them.
-- Each is meant for a simulated world, much faster than real time, once for each seed.

scenario("begins to look around", { battery = 80, seeds = 3, limit = 60 }, function(sim)
	local start = sim:pose()
	sim:run("{{NAME}}.lua")
	sim:wait_until(function()
		local pose = sim:pose()
		return pose.x ~= start.x or pose.y ~= start.y or pose.heading ~= start.heading
	end, 30)
	expect(sim:collisions() == 0)
end)
