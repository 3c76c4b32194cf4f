-- Lesson 10: a patrol for the whole day.

local function leaves(sim, words)
	expect(sim:wait_until(function() return not sim:docked() end, 60), words)
end

-- Waits until it is home; returns the places where it has saved photographs.
local function comes_home(sim)
	local places, known = {}, sim:photos()
	local home = sim:wait_until(function()
		if sim:photos() > known then
			known = sim:photos()
			table.insert(places, sim:pose())
		end
		return sim:docked() and sim:charging()
	end, 400)
	expect(home, "It left its station, but has not come home: robot.dock() does that.")
	return places
end

-- Returns how many of these places are apart from those before them.
local function apart(places)
	local count = 0
	for number, place in places do
		local is_new = true
		for before = 1, number - 1 do
			local other = places[before]
			is_new = is_new and math.sqrt((place.x - other.x) ^ 2 + (place.y - other.y) ^ 2) > 0.2
		end
		count += if is_new then 1 else 0
	end
	return count
end

scenario("A round with three photographs", { world = "playpen", fps = 5, points = 4, seeds = 2, limit = 600 }, function(sim)
	sim:run()
	leaves(sim, "It does not leave its station.")
	local places = comes_home(sim)
	local photos = sim:photos()
	expect(photos > 0, "It came home without a photograph: frame:save saves one.")
	expect(photos >= 3, `There should be a photograph of each of the three legs, but it saved {photos}; each needs a name of its own.`)
	expect(apart(places) >= 3, "It took its photographs at the same place: it should take one at the end of each leg.")
	local driven = sim:distance()
	expect(driven > 1.1, string.format("It drove %.1f metres: three legs of 40 centimetres and the way home are more.", driven))
end)

scenario("It goes again", { world = "playpen", fps = 5, battery = 95, points = 3, seeds = 2, limit = 1000 }, function(sim)
	sim:run()
	leaves(sim, "It does not leave its station.")
	comes_home(sim)
	leaves(sim, "It came home with a good battery, but did not start again.")
	comes_home(sim)
end)

scenario("It charges before it goes again", { world = "playpen", fps = 5, battery = 70, points = 3, seeds = 2, limit = 900 }, function(sim)
	sim:run()
	leaves(sim, "It does not leave its station.")
	sim:battery(50)
	comes_home(sim)
	local stays = not sim:wait_until(function() return not sim:docked() end, 60)
	expect(stays, "It started again at 50 percent: it should charge to 60.")
	sim:battery(63)
	leaves(sim, "Its battery has reached 60 percent, but it did not start again.")
end)
