-- Lesson 8: all the way round the line.

-- Places on the line, in the order in which the robot comes to them.
local PLACES = { { 2.7, 0.6 }, { 3.8, 1.6 }, { 3.35, 2.7 }, { 2.4, 2.3 }, { 1.45, 1.95 }, { 1.15, 1.35 }, { 1.9, 0.6 } }
-- Whoever looks ahead cuts bends a little.
local NEAR = 0.35

local function follows(sim, first, last)
	for number = first, last do
		local place = PLACES[number]
		local there = sim:wait_until(function()
			local pose = sim:pose()
			return math.sqrt((pose.x - place[1]) ^ 2 + (pose.y - place[2]) ^ 2) < NEAR
		end, 30)
		local words = if number == 1
			then "It does not follow the line at all: it has not come a metre far."
			elseif number == 2 then "It does not get round the first bend: there the line turns left."
			else `It has lost the line at bend {number - 1}.`
		expect(there, words)
	end
end

scenario("Round the first bend", { world = "line_loop", fps = 10, points = 4, seeds = 2, limit = 100 }, function(sim)
	sim:run()
	follows(sim, 1, 2)
end)

scenario("All the way round", { world = "line_loop", fps = 10, points = 6, seeds = 2, limit = 300 }, function(sim)
	sim:run()
	follows(sim, 1, #PLACES)
	expect(sim:collisions() == 0, "It ran into something on its way.")
end)
