-- Drives a little now and then, above the patrol, and fails in the middle of it every few minutes: in
-- turn an error, a loop that never waits, and too much memory.
local turns = store.get("turns", 0)
while true do
	task.wait(20 + 100 * math.random())
	robot.move(30, -30)
	task.wait(0.5 + math.random())
	robot.stop()
	if math.random() < 0.1 then
		turns += 1
		store.set("turns", turns)
		task.wait(2)
		robot.move(25, 25)
		task.wait(0.3)
		if turns % 3 == 0 then
			while true do
			end
		elseif turns % 3 == 1 then
			error("restless as it is")
		else
			local hoard = {}
			while true do
				table.insert(hoard, string.rep("x", 10000))
			end
		end
	end
end
