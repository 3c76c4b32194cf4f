-- Explores a room without hitting anything.

-- Lets the robot drive for some seconds, and returns the larger extent of its path along x or y, in
-- metres.
local function spread(sim, seconds)
	local low, high = sim:pose(), sim:pose()
	for _ = 1, seconds do
		sim:wait(1)
		local pose = sim:pose()
		low = { x = math.min(low.x, pose.x), y = math.min(low.y, pose.y) }
		high = { x = math.max(high.x, pose.x), y = math.max(high.y, pose.y) }
	end
	return math.max(high.x - low.x, high.y - low.y)
end

local function explores(sim)
	sim:run("explore.lua")
	local way = spread(sim, 90)
	expect(sim:distance() > 5, `it drives: {sim:distance()} m in a minute and a half`)
	expect(way > 2, `it gets around in the room: its path extends over {way} m`)
	expect(sim:collisions() == 0, `it hits nothing: {sim:collisions()} collisions`)
end

scenario("explores a living room without hitting anything", { battery = 100, fps = 8 }, function(sim)
	sim:place({ x = 1 + 2.2 * math.random(), y = 1.4 + 2.2 * math.random(), heading = 2 * math.pi * math.random() })
	explores(sim)
end)

scenario("explores a hall in which somebody walks", { world = "hall", fps = 8 }, function(sim)
	sim:place({ x = 1 + 1.4 * math.random(), y = 1 + 3.4 * math.random(), heading = 2 * math.pi * math.random() })
	explores(sim)
end)

scenario("explores a classroom with a tiled floor", { world = "classroom", fps = 8 }, function(sim)
	sim:place({ x = 1.1 + 0.4 * math.random(), y = 1 + 3.6 * math.random(), heading = 2 * math.pi * math.random() })
	explores(sim)
end)

scenario("explores a laboratory with glossy tiles as a genuine robot", { world = "laboratory" }, function(sim)
	sim:place({ x = 1.2 + 1.4 * math.random(), y = 1.4 + 2.2 * math.random(), heading = 2 * math.pi * math.random() })
	explores(sim)
end)

scenario("leaves the station when it has charged", { battery = 79 }, function(sim)
	sim:place({ x = 0.6, y = 2.5, heading = math.pi })
	sim:run("dock_now.lua")
	expect(sim:wait_until(function() return sim:ended() end, 60))
	sim:battery(70)
	sim:run("explore.lua")
	expect(sim:wait_until(function() return not sim:docked() end, 60), "it leaves the station at 80 %")
	local way = sim:distance()
	expect(sim:wait_until(function() return sim:distance() > way + 2 end, 30), "it drives away")
end)
