-- Lesson 3: there and back.

-- Returns a function that measures the distance from the place where the robot is now.
local function meter(sim)
	local start = sim:pose()
	return function()
		local pose = sim:pose()
		return math.sqrt((pose.x - start.x) ^ 2 + (pose.y - start.y) ^ 2)
	end
end

-- Returns the angle between the heading `before` and the present one, in radians, 0 to pi.
local function turned(sim, before)
	local by = sim:pose().heading - before
	return math.abs(math.atan2(math.sin(by), math.cos(by)))
end

-- Waits until the robot drives (`wanted` is true) or stands still. Returns whether that happened in
-- time.
local function wait_for_motion(sim, wanted, seconds)
	local far, heading = sim:distance(), sim:pose().heading
	sim:wait(0.1)
	return sim:wait_until(function()
		local moving = sim:distance() - far > 0.001 or math.abs(sim:pose().heading - heading) > 0.01
		far, heading = sim:distance(), sim:pose().heading
		return moving == wanted
	end, seconds)
end

-- Returns the function that measures the distance, and the time at which the robot began to drive.
local function drives_away(sim)
	local away = meter(sim)
	sim:run()
	sim:wait_until(function() return away() > 0.01 end, 8)
	local began = sim:time()
	expect(sim:wait_until(function() return away() > 0.15 end, 8), "The robot does not drive away, or not even 15 centimetres: easy.forward(2) drives for two seconds, with speed 50.")
	return away, began
end

scenario("It drives away", { world = "yard", points = 2, seeds = 3, limit = 30 }, function(sim)
	local away, began = drives_away(sim)
	expect(sim:pose().x > 1.3, "It drives backwards first: easy.forward drives forwards.")
	local far = 0
	sim:wait_until(function()
		local before = far
		far = away()
		return far - before < 0.0005
	end, 10)
	local seconds = sim:time() - began
	expect(seconds > 1.7 and seconds < 2.5, string.format("It drove away for %.1f seconds: it should be two seconds, as with easy.forward(2).", seconds))
end)

scenario("It rests for a second", { world = "yard", points = 3, seeds = 3, limit = 40 }, function(sim)
	local away = drives_away(sim)
	expect(wait_for_motion(sim, false, 10), "It keeps driving: it should stop after two seconds.")
	expect(away() > 0.2, "It drove back without a rest: let it wait for one second before that.")
	local since = sim:time()
	expect(wait_for_motion(sim, true, 6), "It drives away and stays there: it should come back.")
	local rest = sim:time() - since
	expect(rest > 0.6 and rest < 1.6, string.format("It rested for %.1f seconds before it came back: it should be one second.", rest))
end)

scenario("It comes back to where it started", { world = "yard", points = 5, seeds = 3, limit = 50 }, function(sim)
	local heading = sim:pose().heading
	local away = drives_away(sim)
	expect(sim:wait_until(function() return sim:ended() end, 25), "The script does not end: once it is back there is nothing left to do.")
	expect(away() < 0.15, string.format("At the end it is %d centimetres from where it started.", math.round(100 * away())))
	expect(turned(sim, heading) < 2, "It came back, but faces the other way: easy.back drives back without turning round.")
	expect(turned(sim, heading) < 0.3, string.format("It came back, but faces another direction than before, by %d degrees: on the way back both tracks need the same speed.", math.round(math.deg(turned(sim, heading)))))
	expect(sim:collisions() == 0, "It ran into something on its way.")
end)
