-- Scenarios: what {{NAME}}.lua must achieve. Try it:  spykee test
-- Each scenario runs in virtual time, with every seed from 1 to `seeds`.

scenario("drives its square and hits nothing", { battery = 80, seeds = 3, limit = 60 }, function(sim)
	sim:run("{{NAME}}.lua")
	sim:wait(30)
	expect(sim:distance() > 1.5, `it drove {math.round(sim:distance() * 100)} cm only`)
	expect(sim:collisions() == 0, "it ran into something")
end)

scenario("is taken home when the battery runs low, charges and goes on", { battery = 24, limit = 900 }, function(sim)
	sim:run("{{NAME}}.lua")
	for charge = 1, 2 do
		expect(sim:wait_until(function() return sim:charging() end, 300), `it did not come home, charge {charge}`)
		expect(sim:wait_until(function() return not sim:docked() end, 120), `it did not leave its station, charge {charge}`)
		local driven = sim:distance()
		expect(sim:wait_until(function() return sim:distance() > driven + 1 end, 60), `it did not go on, charge {charge}`)
	end
end)
