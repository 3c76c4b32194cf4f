-- What holds whatever the robot answers where nobody knows how it does. Five pictures a second are enough for the rescue
-- behaviour to find its way.

local function anywhere(sim)
	sim:place({ x = 1.5 + 1.5 * math.random(), y = 1.8 + 1.2 * math.random(), heading = 2 * math.pi * math.random() })
end

local function stands(sim, seconds)
	local before = sim:pose()
	sim:wait(seconds)
	local after = sim:pose()
	local way = math.sqrt((after.x - before.x) ^ 2 + (after.y - before.y) ^ 2)
	return way < 0.01 and math.abs(math.sin(after.heading - before.heading)) < 0.01
end

-- The connection ends; the agent is back soon.
local function drop(sim)
	sim:fault({ fault = "drop" })
	sim:wait(8)
	expect(sim:connected(), "it is back")
end

scenario("a robot with a low battery comes home", { battery = 20.6, fps = 5 }, function(sim)
	anywhere(sim)
	sim:run("drives.lua")
	expect(sim:wait_until(function() return sim:charging() end, 200), "home")
end)

scenario("a low robot comes home over a link that drops", { battery = 19, fps = 5 }, function(sim)
	anywhere(sim)
	sim:run("drives.lua")
	sim:wait(3)
	drop(sim)
	drop(sim)
	expect(sim:wait_until(function() return sim:charging() end, 200), "home")
end)

scenario("after a drop the tracks stand", { fps = 5 }, function(sim)
	anywhere(sim)
	sim:run("drives.lua")
	sim:wait(2)
	drop(sim)
	expect(stands(sim, 3))
end)

scenario("after a drop a search is over", { fps = 5 }, function(sim)
	anywhere(sim)
	sim:hide_station(true)
	sim:run("docks.lua")
	sim:wait(4)
	expect(not stands(sim, 1), "it searches")
	drop(sim)
	expect(stands(sim, 3))
end)

scenario("at the end of a run a search is over", { fps = 5 }, function(sim)
	anywhere(sim)
	sim:hide_station(true)
	sim:run("docks.lua")
	sim:wait(4)
	sim:stop()
	sim:wait(1)
	expect(stands(sim, 3))
end)

scenario("docks and charges", { fps = 5 }, function(sim)
	anywhere(sim)
	sim:run("docks.lua")
	expect(sim:wait_until(function() return #sim:log("docked: true") > 0 end, 120), "docked")
	expect(sim:charging())
end)

-- A robot that does not tell its level may have to charge before it leaves.
local function leaves_and_comes_back(sim)
	sim:run("leaves.lua")
	local charges = sim:wait_until(function() return #sim:log("charges first") > 0 end, 1)
	local limit = if charges then 8000 else 200
	expect(sim:wait_until(function() return sim:ended("leaves") end, limit), "it ends by itself")
	expect(sim:ended("leaves") == "done" and sim:charging())
end

scenario("leaves its station and comes back", { limit = 9000, fps = 5 }, function(sim)
	sim:place({ x = 1.2, y = 2.5, heading = math.pi })
	sim:run({ "docks.lua", name = "first" })
	expect(sim:wait_until(function() return sim:charging() end, 120), "on the station")
	sim:wait(6)
	sim:stop()
	leaves_and_comes_back(sim)
end)

scenario("begins on its station, leaves it and comes back", { world = "playpen", limit = 9000, fps = 5 }, function(sim)
	leaves_and_comes_back(sim)
end)

scenario("a low robot that begins on its station stays there or is brought back", { world = "playpen", battery = 12, fps = 5 }, function(sim)
	sim:run("wants_to_leave.lua")
	for _ = 1, 20 do
		sim:wait(5)
		expect(sim:wait_until(function() return sim:charging() end, 40), "it is not back")
	end
end)
