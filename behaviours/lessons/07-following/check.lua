-- Lesson 7: drives to the ball and stops in front of it.

-- Returns the distance from the middle of the robot to the middle of the ball; about 0.25 m of it
-- are inside the two.
local function gap(sim)
	local pose, ball = sim:pose(), sim:ball(1)
	return math.sqrt((pose.x - ball.x) ^ 2 + (pose.y - ball.y) ^ 2)
end

local function goes_to(sim, ball, behind)
	sim:place_ball(1, ball)
	sim:run()
	local first, heading = gap(sim), sim:pose().heading
	local driven = sim:wait_until(function() return gap(sim) < first - 0.2 end, 20)
	local still = sim:distance() < 0.05 and math.abs(sim:pose().heading - heading) < 0.1
	expect(driven or not (behind and still), "It does not drive towards the ball: while no ball is in sight it should turn on the spot.")
	expect(driven, "It does not drive towards the ball.")
	expect(sim:wait_until(function() return gap(sim) < 0.95 end, 25), "It drives towards the ball, but does not get near: it should come to about half a metre.")
	sim:wait(5)
	local now = sim:ball(1)
	local pushed = math.abs(now.x - ball.x) + math.abs(now.y - ball.y)
	expect(pushed < 0.05, "It has pushed the ball away: it should stop earlier.")
	local last, faces = sim:distance(), sim:pose().heading
	sim:wait(3)
	expect(sim:distance() - last < 0.05, "It is near the ball and still driving: it should stop there.")
	local turned = math.abs(math.sin((sim:pose().heading - faces) / 2))
	expect(turned < 0.25, "It has lost the ball and turns on the spot: right in front of the robot a ball is below the picture. It should stop earlier.")
	expect(gap(sim) < 1, "It came near the ball, but did not stay there.")
end

scenario("To a ball in front of it", { world = "yard", fps = 10, points = 5, seeds = 2, limit = 90 }, function(sim)
	goes_to(sim, { x = 3.0, y = 1.8 }, false)
end)

scenario("To a ball behind it", { world = "yard", fps = 10, points = 5, seeds = 2, limit = 90 }, function(sim)
	goes_to(sim, { x = 0.5, y = 2.6 }, true)
end)
