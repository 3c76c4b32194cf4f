-- Lesson 4: a square to the left.

local SIDE = 0.4
local CORNERS = { { SIDE, 0 }, { SIDE, SIDE }, { 0, SIDE }, { 0, 0 } }
-- How near it must come to each, in metres: tracks turn and drive a little less than they are told, and each
-- side and each corner adds to that.
local NEAR = { 0.12, 0.12, 0.12, 0.2 }
local NAMES = { "first", "second", "third", "fourth" }
local ROUND = 2 * math.pi

-- Returns two functions: the distance from a corner of the square that begins here, and the total
-- turn so far in radians, to the left.
local function meters(sim)
	local start, turned = sim:pose(), 0
	local heading = start.heading
	local function away(corner)
		local pose = sim:pose()
		local by = pose.heading - heading
		turned, heading = turned + math.atan2(math.sin(by), math.cos(by)), pose.heading
		local dx, dy = pose.x - start.x - corner[1], pose.y - start.y - corner[2]
		return math.sqrt(dx * dx + dy * dy)
	end
	return away, function() return turned end
end

-- Learners easily mix up radians and degrees, and metres and centimetres.
local function right_units(sim, away, turned)
	expect(math.abs(turned()) < 1.5 * ROUND, "It turns round and round: four quarter turns are enough. easy.left takes degrees, robot.turn radians, such as robot.turn(math.rad(90)).")
	local far = sim:pose().x < 1.2 + SIDE + 0.6
	expect(far, "The first side is far too long: after 40 centimetres it should turn left. easy.drive takes centimetres, 40 for a side; robot.forward takes metres, 0.4.")
end

local function comes_to(sim, away, turned, number)
	local there = sim:wait_until(function()
		return away(CORNERS[number]) < NEAR[number] or math.abs(turned()) > 1.5 * ROUND
	end, 15)
	right_units(sim, away, turned)
	if not there and number == 2 and turned() < -0.5 then
		expect(false, "At the first corner it turned to the right: easy.left(90) turns left.")
	elseif not there and number == 2 then
		expect(math.abs(turned()) > 0.2, "It drove the first side, but turned at no corner: easy.left(90) does that.")
	end
	local words = if number == 1
		then "It has not driven the first side: easy.drive(40) drives 40 centimetres."
		else `It never reached the {NAMES[number]} corner of the square: at each corner it should turn left by 90 degrees, then drive 40 centimetres.`
	expect(there, words)
end

scenario("It drives the first side", { world = "yard", points = 2, seeds = 3, limit = 40 }, function(sim)
	local away, turned = meters(sim)
	sim:run()
	comes_to(sim, away, turned, 1)
	sim:wait(2)
	expect(sim:pose().x < 1.2 + SIDE + 0.2, "The first side is longer than 40 centimetres.")
end)

scenario("It comes to all four corners", { world = "yard", points = 4, seeds = 3, limit = 80 }, function(sim)
	local away, turned = meters(sim)
	sim:run()
	for number = 1, 4 do
		comes_to(sim, away, turned, number)
	end
	expect(sim:collisions() == 0, "It ran into something on its way.")
end)

scenario("It ends where it started", { world = "yard", points = 4, seeds = 3, limit = 80 }, function(sim)
	local away, turned = meters(sim)
	sim:run()
	local ended = sim:wait_until(function()
		away(CORNERS[4])
		return sim:ended() or math.abs(turned()) > 1.5 * ROUND
	end, 60)
	right_units(sim, away, turned)
	expect(ended, "The script does not end: after four sides there is nothing left to do.")
	local driven = sim:distance()
	expect(driven > 1.2, string.format("It drove %.1f metres: a square with sides of 40 centimetres needs 1.6.", driven))
	expect(away(CORNERS[4]) < NEAR[4], string.format("At the end it is %d centimetres from where it started.", math.round(100 * away(CORNERS[4]))))
end)
