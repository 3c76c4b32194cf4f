-- Lesson 9: goes home and reports the result.

local function played(sim, name)
	for _, sound in sim:sounds() do
		if sound.name == name then
			return true
		end
	end
	return false
end

local function leaves(sim)
	local station = sim:pose()
	sim:run()
	expect(sim:wait_until(function() return not sim:docked() end, 30), "It does not leave its station: floor.leave_station() does that.")
	local away = sim:wait_until(function()
		local pose = sim:pose()
		return math.sqrt((pose.x - station.x) ^ 2 + (pose.y - station.y) ^ 2) > 0.75
	end, 30)
	expect(away, "It leaves its station, but does not drive half a metre away from it: robot.forward(0.5) drives where it faces, and floor.leave_station() turns it to where the way is free.")
end

local function ends(sim, seconds)
	expect(sim:wait_until(function() return sim:ended() end, seconds), "The script does not end: once it has reported the result there is nothing left to do.")
	sim:wait(1) -- until the robot has played its last sound
end

scenario("Home again, and a beep", { world = "playpen", points = 4, seeds = 3, limit = 500 }, function(sim)
	leaves(sim)
	expect(sim:wait_until(function() return sim:docked() end, 200), "It does not come home: robot.dock() does that.")
	ends(sim, 60)
	expect(sim:docked(), "It was home, but did not stay there.")
	expect(not played(sim, "alarm"), "It is home, but there was an alarm.")
	expect(played(sim, "bip_2"), 'It is home, but there was no beep: robot.play("bip_2").')
end)

scenario("No station, and the alarm", { world = "playpen", points = 6, seeds = 2, limit = 1500 }, function(sim)
	leaves(sim)
	sim:hide_station(true)
	ends(sim, 1200)
	expect(not played(sim, "bip_2"), "It could not get home, but there was a beep.")
	expect(played(sim, "alarm"), 'It could not get home, but there was no alarm: robot.play("alarm").')
end)
