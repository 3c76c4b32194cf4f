-- right
local fsm = require("@spykee/fsm")

fsm.new({
	initial = "sleep",
	states = {
		sleep = {
			on = { noise = "look" },
		},
		look = {
			enter = function()
				robot.led("flash", true)
			end,
			task = function()
				robot.drive(0, 0.6)
				while true do
					local frame = robot.wait_frame(1)
					if frame and frame:find_blobs("red", { pixels_threshold = 40 })[1] then
						return "laugh_now"
					end
				end
			end,
			exit = function()
				robot.led("flash", false)
			end,
			timeout = { 30, "sleep" },
		},
		laugh_now = {
			task = function()
				robot.play("laugh")
				task.wait(4) -- its own laugh is a noise too
				return "sleep"
			end,
		},
	},
}):run()
