-- Docks from anywhere that the station's beacon reaches.

local function docks(sim, seconds)
	sim:run("dock_now.lua")
	expect(sim:wait_until(function() return sim:ended() end, seconds), "it ends")
	expect(sim:ended() == "done" and sim:docked() and sim:charging())
	expect(#sim:log("on the station and charging") == 1)
end

scenario("docks from anywhere in the living room", { fps = 8 }, function(sim)
	sim:place({ x = 0.7 + 2.4 * math.random(), y = 1 + 2.8 * math.random(), heading = 2 * math.pi * math.random() })
	docks(sim, 200)
end)

-- A genuine robot's receivers do not reach so far: it looks for its station and drives nearer, while
-- somebody walks to and fro before it.
scenario("docks through a door", { world = "hall", fps = 8, limit = 1000 }, function(sim)
	sim:place({ x = 3.7 + 1.5 * math.random(), y = 2.4 + 0.6 * math.random(), heading = 2 * math.pi * math.random() })
	docks(sim, 900)
end)

scenario("reports an error when the station cannot be found", { may_fail = true }, function(sim)
	sim:hide_station(true)
	sim:run({ "dock_now.lua", params = { retries = 0, timeout = 30, places = 0 } })
	expect(sim:wait_until(function() return sim:ended() end, 120), "it ends")
	expect(sim:ended() == "error")
	expect(sim:sounds()[1].name == "alarm")
end)

scenario("searches from other places when the station is not found", { world = "living_room", battery = 90, fps = 8, limit = 200, may_fail = true }, function(sim)
	sim:place({ x = 2.2, y = 2.5, heading = 2 * math.pi * math.random() })
	sim:hide_station(true)
	sim:run({ "dock_now.lua", params = { retries = 0, timeout = 30, places = 2 } })
	expect(sim:wait_until(function() return sim:ended() end, 180), "it ends")
	expect(sim:ended() == "error" and #sim:log("driving on to search") == 2)
	expect(sim:distance() > 0.5, "it drives to another place")
	expect(sim:collisions() == 0, "it hits nothing")
end)
