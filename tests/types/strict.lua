-- Must have no type error, although strict.
local easy = require("@spykee/easy")
local floor = require("@spykee/floor")
local fsm = require("@spykee/fsm")
local station = require("@spykee/station")
local whereabouts = require("@spykee/whereabouts")
local compass = require("@spykee/compass")
print(fsm, station, whereabouts, compass)

robot.on("frame", function(frame: Frame)
	local ball = frame:find_blobs("red", { pixels_threshold = 40 })[1]
	if ball then
		robot.led("left", ball.bearing > 0)
		robot.drive(0.1, ball.bearing)
	end
end, { rate = 5 })

robot.on("noise", function(noise)
	print(noise.dbfs)
end)

robot.once("battery", function(battery: Battery)
	local percent: number? = battery.percent
	print(percent)
end)

robot.on("docked", function()
	robot.play("bip_2")
end)

local frame = robot.wait_frame(2)
if frame then
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	print(line and line.offset, frame:save("a.jpg"))
end

easy.light("left", "on")
easy.drive(40)
floor.leave_station()
local blinking = robot.blink("left", { count = 2 })
print(blinking:join(), task.now())
