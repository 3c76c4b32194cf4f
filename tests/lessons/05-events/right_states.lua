-- right
local fsm = require("@spykee/fsm")
fsm.new({
	initial = "asleep",
	states = {
		asleep = { on = { noise = "awake" } },
		awake = {
			enter = function()
				robot.led("all", true)
			end,
			task = function()
				robot.turn(math.rad(360))
				return "asleep"
			end,
			exit = function()
				robot.led("all", false)
			end,
		},
	},
}):run()
