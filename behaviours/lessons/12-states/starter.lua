-- spykee lesson 12: states
-- A robot with three moods: asleep, awake, happy.
-- Here a noise wakes it, but it does not look for the ball, and never falls asleep again.

local fsm = require("@spykee/fsm")

fsm.new({
	initial = "asleep",
	states = {
		asleep = {
			on = { noise = "awake" },
		},
		awake = {
			enter = function()
				robot.led("flash", true)
			end,
		},
		happy = {},
	},
}):run()
