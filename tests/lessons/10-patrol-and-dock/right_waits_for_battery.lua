-- right
local function round()
	robot.undock()
	robot.turn(math.rad(180))
	for leg = 1, 3 do
		robot.forward(0.4)
		local frame = robot.wait_frame(2)
		if frame then
			frame:save(`leg-{leg}.jpg`)
		end
		robot.turn(math.rad(120))
	end
	robot.dock()
end

while true do
	round()
	while not (robot.battery() and robot.battery().percent >= 60) do
		robot.wait_for("battery", 60)
	end
end
