-- right
local floor = require("@spykee/floor")
local fsm = require("@spykee/fsm")

fsm.new({
	initial = "patrolling",
	states = {
		patrolling = {
			task = function()
				floor.leave_station()
				for leg = 1, 3 do
					robot.forward(0.4)
					local frame = robot.wait_frame(2)
					if frame then
						frame:save(`leg{leg}.jpg`)
					end
					robot.turn(math.rad(120))
				end
				return "going_home"
			end,
		},
		going_home = {
			task = function()
				robot.dock()
				return "charging"
			end,
		},
		charging = {
			task = function()
				while robot.battery().percent < 60 do
					task.wait(5)
				end
				return "patrolling"
			end,
		},
	},
}):run()
