-- Scenarios: what {{NAME}}.lua must achieve. Try it:  spykee test
-- Each scenario runs in virtual time, with every seed from 1 to `seeds`.

scenario("comes to a red ball", { world = "playpen", battery = 80, seeds = 3, limit = 60 }, function(sim)
	sim:place({ x = 0.6, y = 1, heading = 0 })
	sim:place_ball(1, { x = 1.7, y = 1.2 })
	sim:run("{{NAME}}.lua")

	local function distance()
		local robot, ball = sim:pose(), sim:ball(1)
		return math.sqrt((robot.x - ball.x) ^ 2 + (robot.y - ball.y) ^ 2)
	end
	expect(sim:wait_until(function() return distance() < 0.8 end, 30), "it did not come to the ball")
end)

scenario("charges when the battery runs low, and goes on", { battery = 24, fps = 5, limit = 600 }, function(sim)
	sim:run("{{NAME}}.lua")
	expect(sim:wait_until(function() return sim:charging() end, 300), "it did not come home")
	expect(sim:wait_until(function() return not sim:docked() end, 120), "it did not leave its station")
	local driven = sim:distance()
	expect(sim:wait_until(function() return sim:distance() > driven + 0.1 end, 120), "it did not go on")
end)
