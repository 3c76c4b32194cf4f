-- wrong: It took its photographs at the same place
local function round()
	robot.undock()
	robot.turn(math.rad(180))
	for leg = 1, 3 do
		robot.forward(0.4)
		robot.turn(math.rad(120))
	end
	for picture = 1, 3 do
		local frame = robot.wait_frame(2)
		if frame then
			frame:save(`picture-{picture}.jpg`)
		end
	end
	robot.dock()
end

while true do
	round()
	while not (robot.battery() and robot.battery().percent >= 60) do
		robot.wait_for("battery", 60)
	end
end
