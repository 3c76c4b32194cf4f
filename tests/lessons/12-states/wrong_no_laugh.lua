-- wrong: but did not laugh when the ball was in sight
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
						return "asleep"
					end
				end
			end,
			exit = function()
				robot.led("flash", false)
			end,
			timeout = { 30, "asleep" },
		},
	},
}):run()
