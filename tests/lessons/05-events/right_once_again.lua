-- right
local function listen()
	robot.once("noise", function()
		robot.led("all", true)
		robot.turn(math.rad(360))
		robot.led("all", false)
		listen()
	end)
end

listen()
