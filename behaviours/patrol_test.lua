-- The patrol drives its rounds, charges in time, and continues where it stopped.

-- Places the robot near the start of the living room, at another place for each seed.
local function somewhere(sim)
	sim:place({ x = 1.8 + 0.3 * math.random(), y = 2.2 + 0.3 * math.random(), heading = 0.4 * math.random() - 0.2 })
end

-- Returns what the patrol has logged at the beginning of each leg, such as "round 2, leg 3".
local function legs(sim)
	local list = {}
	for _, line in sim:log("round ") do
		table.insert(list, line.text)
	end
	return list
end

local function begins(sim, leg)
	return function()
		local list = legs(sim)
		return list[#list] == leg
	end
end

-- Returns the condition that `is_home` holds. Refills the battery, which is small in this room on
-- purpose, so that it lasts as long as a real one.
local function refilled(sim, level, is_home)
	return function()
		if sim:battery() < level - 4 then
			sim:battery(level)
		end
		return is_home(sim)
	end
end

scenario("drives its legs, photographs and hits nothing", { battery = 90, fps = 8 }, function(sim)
	somewhere(sim)
	sim:run("patrol.lua")
	local before = 0
	for _, leg in { "round 1, leg 2", "round 1, leg 3", "round 1, leg 4", "round 2, leg 1", "round 2, leg 2" } do
		expect(sim:wait_until(begins(sim, leg), 60 - sim:time()), "five legs take a minute at most")
		-- A genuine robot is slower than its commands say, most of all on a rug.
		expect(sim:distance() - before > 0.6 * 0.9, `before {leg}, a leg is driven`)
		before = sim:distance()
	end
	expect(sim:photos() == 15, `three pictures per leg make 15, not {sim:photos()}`)
	expect(sim:collisions() == 0)
end)

scenario("charges in time and continues with the next leg", { battery = 52, fps = 8 }, function(sim)
	somewhere(sim)
	-- While a genuine robot docks, the small battery of the living room may lose 15 percent.
	sim:run({ "patrol.lua", params = { go_home = 47 } })
	expect(sim:wait_until(function() return sim:charging() end, 160), "it goes home at 47 %")
	expect(#sim:log("watchdog") == 0 and sim:battery() > 30, "it goes before the watchdog has to act")
	local before = #legs(sim)
	expect(sim:wait_until(function() return #legs(sim) > before end, 120), "it leaves the station again")
	expect(not sim:docked() and sim:battery() > 70)
	local leg = before % 4 + 1
	expect(string.find(legs(sim)[before + 1], `leg {leg}`), `after {before} legs it drives leg {leg}`)
end)

scenario("a leg that the watchdog cuts short is driven again", { battery = 90, fps = 8, limit = 400 }, function(sim)
	somewhere(sim)
	sim:run("patrol.lua")
	expect(sim:wait_until(begins(sim, "round 1, leg 2"), 60))
	sim:wait(1)
	sim:battery(18)
	expect(sim:wait_until(refilled(sim, 18, sim.charging), 200), "the watchdog takes it home")
	-- If the robot reports its level late, the leg may be over by then.
	local before, cut = #legs(sim), sim:log("was cut short")
	local last = sim:log("round ")[before]
	local leg = tonumber(string.match(last.text, "leg (%d+)"))
	local again = #cut > 0 and cut[#cut].time > last.time
	sim:battery(74)
	expect(sim:wait_until(function() return #legs(sim) > before end, 90), "it leaves the station again")
	local next_leg = if again then leg else leg % 4 + 1
	expect(string.find(legs(sim)[before + 1], `leg {next_leg}`), `the next is leg {next_leg}, not {legs(sim)[before + 1]}`)
end)

scenario("a restart continues with the leg that was not finished", { battery = 90, fps = 8 }, function(sim)
	somewhere(sim)
	sim:run("patrol.lua")
	expect(sim:wait_until(begins(sim, "round 1, leg 3"), 60))
	sim:wait(1.5)
	sim:kill()
	local before = #legs(sim)
	sim:wait(2)
	sim:run("patrol.lua")
	expect(sim:wait_until(function() return #legs(sim) > before end, 10))
	expect(legs(sim)[before + 1] == "round 1, leg 3", `the next is leg 3, not {legs(sim)[before + 1]}`)
end)

scenario("finds its station from a place that the beacon does not reach", { battery = 31, fps = 8, limit = 900 }, function(sim)
	sim:place({ x = 0.35, y = 3.6, heading = 2 * math.pi * math.random() })
	sim:run("patrol.lua")
	expect(sim:wait_until(refilled(sim, 29, sim.docked), 800), "it drives to a place from which it finds the station")
end)

scenario("photographs the dark with its headlight", { battery = 90, fps = 8 }, function(sim)
	somewhere(sim)
	sim:light(0.02)
	sim:run("patrol.lua")
	local function has_seen()
		return #sim:log("I see ") > #sim:log("nothing bright")
	end
	expect(sim:wait_until(has_seen, 60), "it sees what its headlight shines on")
	expect(sim:wait_until(function() return not sim:leds().flash end, 5), "the headlight goes off again")
end)

scenario("drives its rounds, goes home, sums them up once and ends", { battery = 90, fps = 8, limit = 400 }, function(sim)
	somewhere(sim)
	sim:run({ "patrol.lua", params = { rounds = 2, legs = 2 } })
	expect(sim:wait_until(function() return sim:ended("patrol") == "done" end, 350), "it ends by itself")
	expect(sim:docked(), "it is at home")
	expect(#legs(sim) >= 4 and #sim:log("round 3") == 0, "two rounds of two legs")
	local told = sim:log("patrol: ")
	expect(#told == 1, `one message, not {#told}`)
	expect(string.find(told[1].text, "rounds: 2, minutes: %d, pictures: 12; at home, the battery is at %d+ %%"), told[1].text)
end)

scenario("a tour that was cut short goes on at the next start", { battery = 90, fps = 8, limit = 400 }, function(sim)
	local tour = { "patrol.lua", params = { rounds = 2, legs = 2 } }
	somewhere(sim)
	sim:run(tour)
	expect(sim:wait_until(begins(sim, "round 2, leg 1"), 60))
	sim:stop()
	sim:run(tour)
	expect(sim:wait_until(function() return sim:ended("patrol") == "done" end, 350), "it ends by itself")
	expect(sim:docked() and #sim:log("round 3") == 0, "it drives what was left, and goes home")
	expect(#sim:log("patrol: rounds: 2,") == 1, "it sums up the whole tour")
end)

scenario("stands still now and then, and the guard beside it sees who walks by", { world = "hall", battery = 90, fps = 8, limit = 400 }, function(sim)
	sim:place({ x = 1.5 + 0.3 * math.random(), y = 2.4 + 0.4 * math.random(), heading = 0.4 * math.random() - 0.2 })
	sim:run("patrol.lua", "guard.lua")
	expect(sim:wait_until(function() return #sim:log("something moves") > 0 end, 350), "somebody walks by, and is seen")
	expect(#legs(sim) > 0 and not sim:docked(), "the patrol is under way")
end)
