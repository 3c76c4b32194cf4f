-- What the book (behaviours/guide) says that its scripts do, in the world that it names. Each script of a chapter is
-- written beside this file: guide_03.lua is the first one of step 3, guide_03-2.lua the second, guide_journal.lua that of
-- the chapter operate/journal.md. So is exact.yaml, the living room with an exact robot.

local function says(sim, text, seconds)
	expect(sim:wait_until(function() return #sim:log(text) > 0 end, seconds), `it never said "{text}"`)
end

local function ends(sim, seconds)
	expect(sim:wait_until(function() return sim:ended() end, seconds), "it did not end")
	expect(sim:ended() == "done", `it ended as {sim:ended()}`)
end

local function drives(sim, metres, seconds)
	local before = sim:distance()
	local there = sim:wait_until(function() return sim:distance() - before > metres end, seconds)
	expect(there, string.format("it drove %.2f m only", sim:distance() - before))
end

-- Metres from where it stands to a ball.
local function to_ball(sim, number)
	local pose, ball = sim:pose(), sim:ball(number)
	return math.sqrt((pose.x - ball.x) ^ 2 + (pose.y - ball.y) ^ 2)
end

-- By how much it does not look at a ball, in radians.
local function off_ball(sim, number)
	local pose, ball = sim:pose(), sim:ball(number)
	local off = math.atan2(ball.y - pose.y, ball.x - pose.x) - pose.heading
	return math.abs(math.atan2(math.sin(off), math.cos(off)))
end

local function lit(sim)
	local leds = sim:leds()
	return leds.left and leds.right and leds.flash
end

local FIVE = { seeds = 5, fps = 8, limit = 120 }

local function options(more)
	local all = table.clone(FIVE)
	for key, value in more do
		all[key] = value
	end
	return all
end

scenario("01 says hello, and lights up for a second", FIVE, function(sim)
	sim:run("guide_01.lua")
	says(sim, "Hello, I am guide_01", 5)
	expect(sim:wait_until(function() return lit(sim) end, 5), "the lights did not go on")
	local since = sim:time()
	expect(sim:wait_until(function() return not lit(sim) end, 5), "the lights did not go off")
	expect(math.abs(sim:time() - since - 1) < 0.3, "not for a second")
	ends(sim, 5)
end)

scenario("02 drives there, turns, backs and drives on", FIVE, function(sim)
	sim:run("guide_02.lua")
	drives(sim, 0.65, 30)
	ends(sim, 10)
	expect(sim:collisions() == 0)
end)

scenario("03 finds something red and laughs", FIVE, function(sim)
	sim:run("guide_03.lua")
	says(sim, "something red, on the", 30)
	ends(sim, 5)
	expect(sim:sounds()[1].name == "laugh")
end)

scenario("03-2 drives a square, more or less", FIVE, function(sim)
	local start = sim:pose()
	sim:run("guide_03-2.lua")
	says(sim, "a square, more or less", 60)
	expect(sim:distance() > 0.85 and sim:distance() < 1.35, `it drove {sim:distance()} m`)
	local pose = sim:pose()
	expect(math.sqrt((pose.x - start.x) ^ 2 + (pose.y - start.y) ^ 2) < 0.35, "it did not come back")
end)

scenario("04 drives off and goes home", options({ limit = 400 }), function(sim)
	sim:run("guide_04.lua")
	drives(sim, 0.5, 20)
	says(sim, "at home, with", 300)
	expect(sim:charging())
end)

scenario("05 drives ahead, back, and turns", FIVE, function(sim)
	sim:run("guide_05.lua")
	drives(sim, 0.3, 10)
	ends(sim, 10)
end)

scenario("05-2 drives by metres and angles", FIVE, function(sim)
	local heading = sim:pose().heading
	sim:run("guide_05-2.lua")
	ends(sim, 30)
	expect(sim:distance() > 0.55 and sim:distance() < 0.9, `it drove {sim:distance()} m`)
	local turned = math.deg(sim:pose().heading - heading) % 360
	expect(math.abs(turned - 90) < 25, `it turned {turned} degrees`)
end)

scenario("06 says how it went", FIVE, function(sim)
	sim:run("guide_06.lua")
	says(sim, "forward: true done", 20)
	ends(sim, 5)
end)

scenario("06-2 finds itself blocked by the wall, and an exact robot knows how far it came", options({ world = "exact.yaml", fps = 12 }), function(sim)
	local before = sim:pose()
	sim:run("guide_06-2.lua")
	ends(sim, 60)
	local came = tonumber(sim:log("blocked after")[1].text:match("after (%d+) cm"))
	local pose = sim:pose()
	local far = 100 * math.sqrt((pose.x - before.x) ^ 2 + (pose.y - before.y) ^ 2)
	expect(math.abs(came - far) < 25, `it says {came} cm and came {far}`)
end)

scenario("06-3 drives on and on", FIVE, function(sim)
	sim:run("guide_06-3.lua")
	drives(sim, 1.5, 40)
	expect(not sim:ended())
end)

scenario("07 drives, blinks and beeps at the same time", FIVE, function(sim)
	sim:run("guide_07.lua")
	local blinked, dark = false, false
	sim:wait_until(function()
		blinked = blinked or sim:leds().flash
		dark = dark or (blinked and not sim:leds().flash)
		return sim:ended()
	end, 20)
	expect(blinked and dark, "it did not blink")
	expect(#sim:log("the main task is done") == 1)
	expect(#sim:sounds() == 5, `{#sim:sounds()} sounds`)
	expect(sim:distance() > 0.1, "it did not drive")
end)

scenario("08 hears the bell and tells of its battery", options({ world = "yard" }), function(sim)
	sim:run("guide_08.lua")
	says(sim, "what was that?", 60)
	expect(sim:sounds()[1].name == "robot")
	sim:battery(70)
	says(sim, "%, charging: false", 60)
	-- Its level is a voltage, which tells the energy roughly.
	local lines = sim:log("charging: false")
	local level = tonumber(lines[#lines].text:match("^%d+"))
	expect(level and math.abs(level - 70) < 15, lines[#lines].text)
end)

scenario("09 sees a red thing", FIVE, function(sim)
	sim:run("guide_09.lua")
	says(sim, "a red thing, ", 10)
end)

scenario("10 follows the ball", FIVE, function(sim)
	sim:run("guide_10.lua")
	expect(sim:wait_until(function() return to_ball(sim, 1) < 0.8 or to_ball(sim, 1) > 20 end, 60), "it did not come near")
end)

scenario("11 drives off, goes home and says so", options({ limit = 400 }), function(sim)
	sim:run("guide_11.lua")
	says(sim, "docking: done, ", 300)
	expect(sim:charging())
end)

scenario("11-2 hears that the battery is low, and when it is charged", options({ battery = 31, limit = 600 }), function(sim)
	sim:run("guide_11-2.lua")
	says(sim, "low: ", 120)
	says(sim, "charged enough: out again", 400)
	expect(not sim:docked())
end)

scenario("11-3 waits for a grant", FIVE, function(sim)
	sim:run("guide_11-3.lua")
	sim:wait(10)
	expect(not sim:ended(), "it lives on")
	expect(sim:distance() < 0.01, "nothing is granted to it")
end)

scenario("12 drives as many legs as it was told", FIVE, function(sim)
	sim:run({ "guide_12.lua", params = { legs = 2, speed = 60 } })
	says(sim, "2 legs driven", 20)
	expect(sim:distance() > 0.2)
end)

scenario("13 counts its runs", FIVE, function(sim)
	for run = 1, 3 do
		sim:run("guide_13.lua")
		says(sim, `this is run number {run}`, 5)
		local lit, blinks = false, 0
		sim:wait_until(function()
			local now = sim:leds().flash
			if now and not lit then
				blinks += 1
			end
			lit = now
			return sim:ended()
		end, 5)
		expect(blinks == run, `it blinked {blinks} times`)
		ends(sim, 5)
		sim:stop()
	end
end)

scenario("14 keeps the ball in the middle", FIVE, function(sim)
	sim:place({ x = 1.8, y = 2.4, heading = 0.15 + 0.2 * math.random() })
	sim:run("guide_14.lua")
	expect(sim:wait_until(function() return off_ball(sim, 1) < math.rad(4) end, 20), `it looks {math.deg(off_ball(sim, 1))} degrees past it`)
	-- Still in view of a robot that has turned a little too far.
	sim:place_ball(1, { x = 3.7, y = 2.9 })
	expect(sim:wait_until(function() return off_ball(sim, 1) < math.rad(4) end, 20), "it did not follow the ball")
	expect(sim:distance() < 0.1, "it turns on the spot")
end)

scenario("15 searches, approaches and laughs", FIVE, function(sim)
	sim:run("guide_15.lua")
	says(sim, "there it is", 100)
	ends(sim, 5)
	expect(sim:wait_until(function() return #sim:sounds() > 0 end, 1) and sim:sounds()[1].name == "laugh", "it did not laugh")
	expect(not sim:leds().left, "the light of the search is off")
end)

scenario("16 drives to red things until it goes home", options({ limit = 500 }), function(sim)
	sim:run("guide_16.lua")
	says(sim, "there it is", 100)
	says(sim, "going home", 200)
	ends(sim, 200)
	expect(sim:docked())
end)

scenario("17 patrols, photographs and comes home", options({ battery = 60, limit = 700 }), function(sim)
	sim:run("guide_17.lua")
	expect(sim:wait_until(function() return sim:photos() > 0 end, 120), "it has not photographed anything red")
	expect(sim:wait_until(function() return sim:docked() end, 500), "it has not come home")
end)

scenario("journal remembers and tells what it heard", options({ limit = 60 }), function(sim)
	sim:run("guide_journal.lua")
	sim:wait(5)
	sim:noise(-10, 1)
	says(sim, "notified", 20)
end)

scenario("service strikes the hour and notes it", FIVE, function(sim)
	sim:clock("2026-05-04 15:00")
	sim:run("guide_service.lua")
	ends(sim, 10)
	expect(#sim:sounds() == 3, `it struck {#sim:sounds()} times`)
	expect(not sim:leds().left, "the light is off again")
end)

-- A robot often begins on its station: what drives leaves it first.
for _, key in { "02", "05", "05-2", "06", "06-2", "06-3", "07", "12" } do
	scenario(`{key} leaves the station first`, { world = "playpen", battery = 90, fps = 5, limit = 120 }, function(sim)
		expect(sim:docked())
		sim:run(`guide_{key}.lua`)
		expect(sim:wait_until(function() return sim:ended() or sim:distance() > 0.8 end, 60), "it does not get on")
		expect(not sim:docked(), "it is on its station again")
		expect(sim:distance() > 0.3, "it did not drive")
	end)
end
