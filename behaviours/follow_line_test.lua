-- Follows the line all the way round, in both directions.

local LOOP = { { 1.0, 0.6 }, { 3.9, 0.6 }, { 3.9, 2.9 }, { 2.6, 2.9 }, { 2.2, 1.9 }, { 1.0, 2.2 } }
local SIDES = { { 2.4, 0.6 }, { 3.9, 1.75 }, { 3.2, 2.9 }, { 2.4, 2.4 }, { 1.6, 2.05 }, { 1.0, 1.4 } }

-- Returns the metres from a pose to the straight line between `from` and `to`.
local function from_leg(pose, from, to)
	local x, y = to[1] - from[1], to[2] - from[2]
	local part = ((pose.x - from[1]) * x + (pose.y - from[2]) * y) / (x * x + y * y)
	part = math.clamp(part, 0, 1)
	return math.sqrt((from[1] + part * x - pose.x) ^ 2 + (from[2] + part * y - pose.y) ^ 2)
end

local function off_the_loop(pose)
	local least = math.huge
	for i, corner in LOOP do
		least = math.min(least, from_leg(pose, corner, LOOP[i % #LOOP + 1]))
	end
	return least
end

-- Checks that the robot passes the middles of the sides in this order, and is never far from the
-- line.
local function round(sim, order)
	local worst = 0
	for _, side in order do
		local passes = sim:wait_until(function()
			local pose = sim:pose()
			worst = math.max(worst, off_the_loop(pose))
			return math.sqrt((pose.x - SIDES[side][1]) ^ 2 + (pose.y - SIDES[side][2]) ^ 2) < 0.3
		end, 40)
		expect(passes, `it comes to side {side}`)
	end
	expect(worst < 0.3, `it stays on the line: it was {worst} m off`)
end

local function begin(sim, heading)
	sim:place({ x = 1.7 + 0.4 * math.random(), y = 0.54 + 0.12 * math.random(), heading = heading + 0.4 * math.random() - 0.2 })
	sim:run("follow_line.lua")
end

scenario("follows the line all the way round", { world = "line_loop" }, function(sim)
	begin(sim, 0)
	round(sim, { 1, 2, 3, 4, 5, 6, 1 })
	expect(sim:collisions() == 0)
end)

scenario("follows the line in the other direction", { world = "line_loop" }, function(sim)
	begin(sim, math.pi)
	round(sim, { 6, 5, 4, 3, 2, 1 })
	expect(sim:collisions() == 0)
end)

scenario("turns at the end of a line and comes back", { world = "line_loop" }, function(sim)
	sim:place({ x = 0.5, y = 2.4, heading = -math.pi / 2 + 0.2 * math.random() - 0.1 })
	sim:run({ "follow_line.lua", params = { colour = "blue" } })
	expect(sim:wait_until(function() return sim:pose().y < 0.9 end, 30), "it comes to the end")
	expect(sim:wait_until(function() return sim:pose().y > 2.2 end, 60), "it comes back")
	expect(sim:collisions() == 0)
end)

-- The start is 1.4 m from the station. From 1.0 m, its black foot is in those rows of the picture in
-- which a line may begin, and is followed: at the edge of the picture, or where a row of pixels just
-- grazes it, it looks like tape.
scenario("stands still without a line", { world = "playpen" }, function(sim)
	sim:place({ x = 1.6, y = 1.2, heading = 6 * math.random() })
	sim:run("follow_line.lua")
	sim:wait(15)
	expect(#sim:log("no line in sight") == 1)
	local heading = sim:pose().heading
	sim:wait(3)
	expect(math.abs(sim:pose().heading - heading) < 0.01 and sim:distance() < 0.1)
end)
