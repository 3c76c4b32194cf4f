-- wrong: its flash is still on
local fsm = require("@spykee/fsm")
fsm.new({
	initial = "asleep",
	states = {
		asleep = { on = { noise = "awake" } },
		awake = {
			enter = function()
				robot.led("flash", true)
			end,
			task = function()
				robot.drive(0, 0.6)
				while true do
					local frame = robot.wait_frame(1)
					if frame and frame:find_blobs("red", { pixels_threshold = 40 })[1] then
						return "happy"
					end
				end
			end,
			timeout = { 30, "asleep" },
		},
		happy = {
			task = function()
				robot.play("laugh")
				task.wait(4)
				return "asleep"
			end,
		},
	},
}):run()
