-- wrong: A noise does not wake it
local fsm = require("@spykee/fsm")
local machine = fsm.new({
	initial = "asleep",
	states = {
		asleep = { on = { noise = "awake" } },
		awake = {
			enter = function()
				robot.led("flash", true)
			end,
			exit = function()
				robot.led("flash", false)
			end,
			timeout = { 30, "asleep" },
		},
	},
})
print("ready", machine ~= nil)
task.wait(1000)
