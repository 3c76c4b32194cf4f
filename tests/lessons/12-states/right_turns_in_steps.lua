-- right
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
				while true do
					robot.turn(math.rad(25))
					local frame = robot.wait_frame(1)
					if frame and #frame:find_blobs("red", { pixels_threshold = 40 }) > 0 then
						return "happy"
					end
				end
			end,
			exit = function()
				robot.led("flash", false)
			end,
			timeout = { 30, "asleep" },
		},
		happy = {
			enter = function()
				robot.play("laugh")
			end,
			timeout = { 4, "asleep" },
		},
	},
}):run()
