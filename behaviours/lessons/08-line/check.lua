-- Lesson 8: all the way round the line.

-- Places on the line, in the order in which the robot comes to them.
local PLACES = { { 2.7, 0.6 }, { 3.8, 1.6 }, { 3.35, 2.7 }, { 2.4, 2.3 }, { 1.45, 1.95 }, { 1.15, 1.35 }, { 1.9, 0.6 } }
-- A robot that looks ahead cuts bends a little.
local NEAR = 0.35

local function follows(sim, first, last)
	for number = first, last do
		local place = PLACES[number]
		local there = sim:wait_until(function()
			local pose = sim:pose()
			return math.sqrt((pose.x - place[1]) ^ 2 + (pose.y - place[2]) ^ 2) < NEAR
		end, 30)
		local words = if number == 1
			then "It does not follow the line at all: it has not come one metre far."
			elseif number == 2 then "It does not get round the first bend: there the line turns left."
			else `It has lost the line at bend {number - 1}.`
		expect(there, words)
	end
end

scenario("Round the first bend", { world = "line_loop", fps = 10, points = 2, seeds = 2, limit = 100 }, function(sim)
	sim:run()
	follows(sim, 1, 2)
end)

scenario("All the way round", { world = "line_loop", fps = 10, points = 4, seeds = 2, limit = 300 }, function(sim)
	sim:run()
	follows(sim, 1, #PLACES)
	expect(sim:collisions() == 0, "It ran into something on its way.")
end)

-- Places the robot on the straight part of the line, `left` metres to the left of it, as if a
-- person held it there.
local function hold(sim, left)
	sim:place({ x = 2.4, y = 0.6 + left, heading = 0 })
end

-- Returns how fast the robot turns to the right while it is held `left` metres to the left of the
-- line, in radians per second.
local function turning(sim, left)
	local turned = 0
	for try = 1, 60 do
		hold(sim, left)
		sim:wait(0.03) -- so short that no picture shows the line from a robot that has turned far
		if try > 20 then -- by then a picture has arrived and has had an effect
			turned -= sim:pose().heading
		end
	end
	return turned
end

scenario("The farther the line is to one side, the faster it turns", { world = "line_loop", fps = 10, points = 2, seeds = 2, limit = 60 }, function(sim)
	sim:run()
	sim:wait(1)
	local turns = {}
	for _, left in { 0.06, 0.08, 0.1, 0.12 } do -- farther out the tracks may be at their limit
		table.insert(turns, turning(sim, left))
	end
	expect(turns[4] > 0.1, "The line is to the right, but it does not turn right: for that the second number of robot.drive must be negative.")
	for place = 2, 4 do
		local grows = turns[place] > math.max(1.04 * turns[place - 1], turns[place - 1] + 0.02)
		expect(grows, "It turns as fast for a line that is nearly in the middle as for one farther out: let it turn in proportion to the line's offset.")
	end
end)

-- Whether the script has failed because of a nil.
local function failed_on_nil(sim)
	for _, line in sim:log("nil") do
		if line.level == "error" then
			return true
		end
	end
	return false
end

scenario("It looks for a lost line where it was last", { world = "line_loop", fps = 10, points = 2, seeds = 2, limit = 90, may_fail = true }, function(sim)
	sim:run()
	for side, name in { [1] = "right", [-1] = "left" } do
		hold(sim, 0)
		sim:wait(1)
		for _ = 1, 5 do
			hold(sim, 0.1 * side) -- in sight, to that side
			sim:wait(0.1)
		end
		hold(sim, 0.45 * side) -- out of sight
		local turned = sim:wait_until(function() return math.abs(sim:pose().heading) > 0.3 end, 4)
		expect(not failed_on_nil(sim), "The script fails when there is no line in the picture: find_line returns nil then. Test for that before you use the line: if line then ... else ... end.")
		expect(turned, "When the line is lost it stands still: it should turn and look for it.")
		local there = sim:pose().heading * side < 0
		expect(there, `The line was last to the {name}, but it looked for it on the other side: remember the last offset in a variable that you make before robot.on.`)
	end
end)
