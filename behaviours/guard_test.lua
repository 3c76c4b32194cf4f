-- The guard raises the alarm for motion and for loud noises, and for nothing else.

local function alarms(sim)
	return #sim:log("alarm ")
end

-- Whether an alarm is due to the door bell, which rings in the living room at 20 s and then once a
-- minute.
local function is_bell(line)
	local into = (line.time - 20) % 60
	return string.find(line.text, "a noise of") ~= nil and into < 2
end

-- Returns the number of alarms that are not due to the bell.
local function false_alarms(sim)
	local count = 0
	for _, line in sim:log("alarm ") do
		count += if is_bell(line) then 0 else 1
	end
	return count
end

scenario("somebody walks by: photograph, alarm, log", { world = "hall", fps = 8 }, function(sim)
	sim:place({ x = 3.7 + 0.4 * math.random(), y = 2.3 + 0.6 * math.random(), heading = 0.3 * math.random() - 0.15 })
	sim:run("guard.lua")
	expect(sim:wait_until(function() return alarms(sim) > 0 end, 60), "there is an alarm before Ada has walked once round")
	expect(#sim:log("something moves") > 0)
	expect(sim:photos() > 0)
	expect(sim:sounds()[1].name == "alarm")
	expect(sim:distance() < 0.01, "it does not drive")
end)

scenario("a loud noise: alarm and log, once in a while", { world = "playpen", fps = 8 }, function(sim)
	sim:run("guard.lua")
	sim:wait(5)
	sim:noise(-12, 2)
	expect(sim:wait_until(function() return #sim:log("a noise of") > 0 end, 5), "there is an alarm at once")
	sim:wait(5)
	sim:noise(-12, 2)
	sim:wait(5)
	expect(alarms(sim) == 1, "there is no second alarm so soon")
	sim:wait(20)
	sim:noise(-12, 2)
	expect(sim:wait_until(function() return alarms(sim) == 2 end, 5), "there is another alarm later")
end)

scenario("the door bell rings in the living room", { battery = 90, fps = 5 }, function(sim)
	sim:place({ x = 1 + 2 * math.random(), y = 1.5 + 2 * math.random(), heading = 2 * math.pi * math.random() })
	sim:run("guard.lua")
	sim:wait(85)
	expect(#sim:log("a noise of") == 2, `it rings twice: {#sim:log("a noise of")} alarms`)
	expect(false_alarms(sim) == 0, "nobody is there")
end)

scenario("no alarm in a quiet room, nor when the light changes", { battery = 90, fps = 8 }, function(sim)
	sim:place({ x = 1 + 2 * math.random(), y = 1.5 + 2 * math.random(), heading = 2 * math.pi * math.random() })
	sim:run("guard.lua")
	for _, light in { 1, 0.6, 0.3, 1 } do
		sim:light(light)
		sim:wait(15)
	end
	expect(false_alarms(sim) == 0, "nobody is there")
end)

scenario("no alarm in an empty room beside a patrol, nor on the way home", { fps = 5, limit = 400 }, function(sim)
	sim:run("patrol.lua", "guard.lua")
	expect(sim:wait_until(function() return sim:docked() end, 300), "the patrol did not charge")
	sim:wait(60)
	expect(sim:distance() > 4, "the patrol did not drive")
	expect(false_alarms(sim) == 0, "nobody is there")
end)

scenario("no alarm when a person turns or carries the robot", { battery = 90, fps = 5 }, function(sim)
	sim:place({ x = 2, y = 2.5, heading = 0 })
	sim:run("guard.lua")
	for turn = 1, 8 do
		sim:wait(4)
		sim:place({ x = 2, y = 2.5, heading = 0.25 * turn })
	end
	sim:wait(5)
	expect(false_alarms(sim) == 0, "only the robot was moved")
end)

scenario("keeps counting its alarms after a restart", { world = "playpen", fps = 8 }, function(sim)
	for expected = 1, 2 do
		sim:run({ "guard.lua", params = { alarm = false } })
		sim:wait(5)
		sim:noise(-12, 2)
		expect(sim:wait_until(function() return #sim:log(`alarm {expected}:`) > 0 end, 5))
		sim:wait(3)
		sim:stop()
	end
	expect(#sim:sounds() == 0, "without `alarm` it is silent")
end)
