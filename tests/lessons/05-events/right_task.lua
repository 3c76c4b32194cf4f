-- right
task.spawn(function()
	while true do
		if robot.wait_for("noise", 60) then
			robot.led("all", true)
			robot.turn(math.rad(-360))
			robot.led("all", false)
		end
	end
end)
