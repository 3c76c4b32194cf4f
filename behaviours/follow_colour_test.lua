-- Drives up to the ball, and follows it.

local function distance(sim)
	local pose, ball = sim:pose(), sim:ball(1)
	return math.sqrt((pose.x - ball.x) ^ 2 + (pose.y - ball.y) ^ 2)
end

local function begin(sim)
	sim:place({ x = 0.7 + 0.3 * math.random(), y = 0.5 + 1.5 * math.random(), heading = 2 * math.pi * math.random() })
	sim:place_ball(1, { x = 1.7 + 0.8 * math.random(), y = 0.6 + 1.2 * math.random() })
	sim:run("follow_colour.lua")
end

scenario("finds the ball and stops in front of it", { world = "playpen" }, function(sim)
	begin(sim)
	expect(sim:wait_until(function() return #sim:log("following") > 0 end, 20), "it sees the ball")
	sim:wait(15)
	local way = sim:distance()
	sim:wait(3)
	expect(sim:distance() - way < 0.1, "it has come to rest")
	expect(distance(sim) > 0.3 and distance(sim) < 0.9, `it stops at arm's length, not at {distance(sim)} m`)
	expect(sim:collisions() == 0)
end)

scenario("goes after a ball that moves away", { world = "living_room", battery = 90 }, function(sim)
	sim:place({ x = 1.2, y = 2.2 + 0.6 * math.random(), heading = 0.4 * math.random() - 0.2 })
	sim:place_ball(1, { x = 2, y = 2.4 })
	sim:run("follow_colour.lua")
	for step = 0, 150 do
		sim:place_ball(1, { x = 2 + 0.015 * step, y = 2.4 + 0.4 * math.sin(step / 25) })
		sim:wait(0.1)
	end
	expect(sim:pose().x > 3, `it has followed the ball: x is {sim:pose().x} m`)
	sim:wait(5)
	expect(distance(sim) > 0.3 and distance(sim) < 1, `it is near the ball: {distance(sim)} m`)
	expect(sim:collisions() == 0)
end)

scenario("looks around when the ball is gone, and finds it again", { world = "playpen" }, function(sim)
	begin(sim)
	sim:wait(12)
	sim:place_ball(1, { x = 0.6, y = 2.1 })
	expect(sim:wait_until(function() return distance(sim) < 0.9 end, 40), "it finds the ball again")
end)
