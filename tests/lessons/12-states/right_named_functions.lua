-- right
local fsm = require("@spykee/fsm")

local function light_on()
	robot.led("flash", true)
end

local function light_off()
	robot.led("flash", false)
end

local function search()
	robot.drive(0, -0.5)
	local ball
	repeat
		local frame = robot.wait_frame(1)
		ball = frame and frame:find_blobs("red", { pixels_threshold = 40 })[1]
	until ball
	return "happy"
end

local function laugh()
	robot.play("laugh")
	task.wait(5)
	return "asleep"
end

local asleep = { on = { noise = "awake" } }
local awake = { enter = light_on, task = search, exit = light_off, timeout = { 30, "asleep" } }
local happy = { task = laugh }
fsm.new({ initial = "asleep", states = { asleep = asleep, awake = awake, happy = happy } }):run()
