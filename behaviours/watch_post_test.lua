-- The watch post stands where the guard sees who comes, and is at home afterwards.

local function alarms(sim)
	return #sim:log("something moves")
end

scenario("the guard beside it sees who walks by, and it goes home", { world = "hall", battery = 90, fps = 8 }, function(sim)
	sim:run({ "watch_post.lua", params = { minutes = 2 } }, "guard.lua")
	expect(sim:wait_until(function() return #sim:log("watching") > 0 end, 60), "it leaves its station")
	expect(sim:wait_until(function() return alarms(sim) > 0 end, 120), "somebody walks by, and is seen")
	expect(sim:wait_until(function() return sim:docked() end, 240), "it goes home")
	expect(sim:ended("watch_post") == "done")
end)

scenario("a low battery ends the watch", { world = "playpen", battery = 90, fps = 5 }, function(sim)
	sim:run({ "watch_post.lua", params = { minutes = 30 } })
	expect(sim:wait_until(function() return not sim:docked() end, 60), "it leaves its station")
	sim:wait(20)
	sim:battery(18)
	expect(sim:wait_until(function() return sim:ended("watch_post") end, 180), "the watch ends")
	expect(sim:docked() and #sim:log("taken home early") == 1)
end)
