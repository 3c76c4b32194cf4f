-- The patrol drives its beat, charges in time, and goes on where it was.

-- Somewhere around the start of the living room, another place for each seed.
local function somewhere(sim)
	sim:place({ x = 1.8 + 0.3 * math.random(), y = 2.2 + 0.3 * math.random(), heading = 0.4 * math.random() - 0.2 })
end

-- What the patrol says when a leg begins: "round 2, leg 3".
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

scenario("drives its beat, photographs and hits nothing", { battery = 90, fps = 8 }, function(sim)
	somewhere(sim)
	sim:run("patrol.lua")
	expect(sim:wait_until(begins(sim, "round 2, leg 2"), 60), "five legs take a minute at most")
	expect(sim:distance() > 5 * 0.7, "each leg is driven")
	expect(sim:photos() == 15, `three pictures a leg, not {sim:photos()} in all`)
	expect(sim:collisions() == 0)
end)

scenario("charges in time and takes up the beat at the next leg", { battery = 35, fps = 8 }, function(sim)
	somewhere(sim)
	sim:run("patrol.lua")
	expect(sim:wait_until(function() return sim:charging() end, 120), "it goes home at 30 %")
	expect(#sim:log("watchdog") == 0 and sim:battery() > 20, "before the watchdog has to")
	local before = #legs(sim)
	expect(sim:wait_until(function() return #legs(sim) > before end, 120), "it goes out again")
	expect(not sim:docked() and sim:battery() > 70)
	local leg = before % 4 + 1
	expect(string.find(legs(sim)[before + 1], `leg {leg}`), `after {before} legs comes leg {leg}`)
end)

scenario("a leg that the watchdog cuts short is driven again", { battery = 90, fps = 8 }, function(sim)
	somewhere(sim)
	sim:run("patrol.lua")
	expect(sim:wait_until(begins(sim, "round 1, leg 2"), 60))
	sim:wait(1)
	sim:battery(18)
	expect(sim:wait_until(function() return sim:charging() end, 120), "the watchdog takes it home")
	-- Where the robot tells its level late, the leg may be over by then.
	local before, cut = #legs(sim), sim:log("was cut short")
	local last = sim:log("round ")[before]
	local leg = tonumber(string.match(last.text, "leg (%d+)"))
	local again = #cut > 0 and cut[#cut].time > last.time
	sim:battery(74)
	expect(sim:wait_until(function() return #legs(sim) > before end, 90), "it goes out again")
	local next_leg = if again then leg else leg % 4 + 1
	expect(string.find(legs(sim)[before + 1], `leg {next_leg}`), `leg {next_leg}, not {legs(sim)[before + 1]}`)
end)

scenario("a restart goes on at the leg that was not finished", { battery = 90, fps = 8 }, function(sim)
	somewhere(sim)
	sim:run("patrol.lua")
	expect(sim:wait_until(begins(sim, "round 1, leg 3"), 60))
	sim:wait(1.5)
	sim:kill()
	local before = #legs(sim)
	sim:wait(2)
	sim:run("patrol.lua")
	expect(sim:wait_until(function() return #legs(sim) > before end, 10))
	expect(legs(sim)[before + 1] == "round 1, leg 3", `leg 3, not {legs(sim)[before + 1]}`)
end)

scenario("finds its station from where the beacon does not shine", { battery = 31, limit = 900 }, function(sim)
	sim:place({ x = 0.35, y = 3.6, heading = 2 * math.pi * math.random() })
	sim:run("patrol.lua")
	local function is_home()
		-- As long as a real robot's: this room's battery is small on purpose.
		if sim:battery() < 25 then
			sim:battery(29)
		end
		return sim:docked()
	end
	expect(sim:wait_until(is_home, 800), "it goes on to where the station is found")
end)
