-- Lesson 4: a square to the left.

local SIDE = 0.4
local CORNERS = { { SIDE, 0 }, { SIDE, SIDE }, { 0, SIDE }, { 0, 0 } }
local NAMES = { "first", "second", "third", "fourth" }

-- How far it is from a corner of the square that begins here.
local function meter(sim)
	local start = sim:pose()
	return function(corner)
		local pose = sim:pose()
		local dx, dy = pose.x - start.x - corner[1], pose.y - start.y - corner[2]
		return math.sqrt(dx * dx + dy * dy)
	end
end

local function comes_to(sim, away, number)
	local there = sim:wait_until(function() return away(CORNERS[number]) < 0.12 end, 15)
	expect(there, `It never came to the {NAMES[number]} corner of the square.`)
end

scenario("It drives the first side", { world = "yard", points = 2, seeds = 3, limit = 40 }, function(sim)
	local away = meter(sim)
	sim:run()
	comes_to(sim, away, 1)
	sim:wait(2)
	expect(sim:pose().x < 1.2 + SIDE + 0.2, "The first side is longer than 40 centimetres.")
end)

scenario("It comes to all four corners", { world = "yard", points = 4, seeds = 3, limit = 80 }, function(sim)
	local away = meter(sim)
	sim:run()
	for number = 1, 4 do
		comes_to(sim, away, number)
	end
	expect(sim:collisions() == 0, "It ran into something on its way.")
end)

scenario("It ends where it began", { world = "yard", points = 4, seeds = 3, limit = 80 }, function(sim)
	local away = meter(sim)
	sim:run()
	expect(sim:wait_until(function() return sim:ended() end, 60), "The script does not end: after four sides there is nothing left to do.")
	local driven = sim:distance()
	expect(driven > 1.2, string.format("It drove %.1f metres: a square with sides of 40 centimetres needs 1.6.", driven))
	expect(away(CORNERS[4]) < 0.2, string.format("In the end it stands %d centimetres from where it began.", math.round(100 * away(CORNERS[4]))))
end)
