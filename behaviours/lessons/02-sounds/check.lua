-- Lesson 2: a doorbell.

local function times_of(sim, name)
	local times = {}
	for _, sound in sim:sounds() do
		if sound.name == name then
			table.insert(times, sound.time)
		end
	end
	return times
end

local function listen(sim)
	sim:run()
	expect(sim:wait_until(function() return sim:ended() end, 20), "The script does not end: after the laugh there is nothing left to do.")
end

scenario("Three beeps", { world = "yard", points = 3, limit = 30 }, function(sim)
	listen(sim)
	local count = #times_of(sim, "bip_2")
	expect(count > 0, 'There was no beep, or only for a moment: easy.sound("bip_2") plays one, easy.wait(1) lets it sound.')
	expect(count == 3, `There should be three beeps, but there {if count == 1 then "was 1" else "were " .. count}.`)
end)

scenario("One beep per second", { world = "yard", points = 4, limit = 30 }, function(sim)
	listen(sim)
	local times = times_of(sim, "bip_2")
	expect(#times > 1, "There should be one beep per second; for that there must be more than one.")
	for beep = 2, #times do
		local gap = times[beep] - times[beep - 1]
		expect(gap > 0.7 and gap < 1.5, string.format("Beep %d came %.1f seconds after the one before: it should be one second.", beep, gap))
	end
end)

scenario("A laugh after the last beep", { world = "yard", points = 3, limit = 30 }, function(sim)
	listen(sim)
	local sounds = sim:sounds()
	expect(#sounds > 0, "No sound was played.")
	expect(sounds[#sounds].name == "laugh", `The last sound was "{sounds[#sounds].name}": it should be "laugh".`)
	expect(#times_of(sim, "laugh") == 1, "It laughed more than once: once, at the end, is enough.")
	local beeps = times_of(sim, "bip_2")
	expect(#beeps > 0, "It laughed without a beep before, or at the same moment.")
	local gap = sounds[#sounds].time - beeps[#beeps]
	expect(gap > 0.1, "The laugh came at the same moment as the last beep: let it wait before it laughs.")
	expect(gap > 0.4, string.format("The laugh came %.1f seconds after the last beep, on top of it: it should be at least half a second.", gap))
end)
