-- Greets people and QR codes, but not too often.

local function greetings(sim, whom)
	return #sim:log(`hello, {whom}`)
end

scenario("greets a QR code with its text, once", { world = "gallery", fps = 8 }, function(sim)
	local function read()
		return greetings(sim, "screen: front!") == 1
	end
	sim:run("greet.lua")
	for _ = 1, 4 do -- people do not hold a code quite still
		sim:place({ x = 3.4 + 0.2 * math.random(), y = 1.75 + 0.2 * math.random(), heading = math.pi / 2 + 0.2 * math.random() - 0.1 })
		sim:wait_until(read, 5)
	end
	expect(read(), "it reads the sign")
	expect(sim:sounds()[1].name == "robot")
	sim:wait(40)
	expect(greetings(sim, "screen: front!") == 1, "it greets the same sign only once")
end)

scenario("greets a person who walks by, but not too often", { world = "hall", fps = 8 }, function(sim)
	sim:place({ x = 3.7 + 0.3 * math.random(), y = 2.3 + 0.6 * math.random(), heading = 0.3 * math.random() - 0.15 })
	sim:run("greet.lua")
	expect(sim:wait_until(function() return greetings(sim, "stranger!") > 0 end, 60), "it sees Ada")
	sim:wait(65)
	expect(greetings(sim, "") <= 3, "it greets at most every half minute")
	expect(sim:distance() < 0.01, "it stands still")
end)

scenario("greets nobody while a patrol drives", { fps = 5, limit = 300 }, function(sim)
	sim:run("patrol.lua", "greet.lua")
	sim:wait(200)
	expect(sim:distance() > 4, "the patrol did not drive")
	expect(greetings(sim, "") == 0, "nobody is there")
end)

scenario("greets nobody in an empty room, and no ball", { battery = 90, fps = 8 }, function(sim)
	sim:place({ x = 1.4, y = 1.5 + 2 * math.random(), heading = 0.6 * math.random() - 0.3 })
	sim:run("greet.lua")
	for step = 0, 60 do
		sim:place_ball(1, { x = 3.6, y = 1.5 + 0.03 * step })
		sim:wait(0.5)
	end
	expect(greetings(sim, "") == 0)
end)
