-- {{NAME}}: drives a square, again and again, and looks around at each corner.
--
-- Try it:  spykee run {{NAME}}.lua --sim

local SIDE = 0.6 -- metres
local SPEED = 0.25 -- metres a second

robot.on("battery_low", function(battery)
	log.warn(`{battery.percent} % left: the watchdog takes me home`)
end)

if robot.undock() then
	robot.turn(math.pi) -- it has backed out and looks at its station
end

while true do
	local ok, code = robot.forward(SIDE, SPEED)
	if not ok then
		log.info(`did not get to the corner: {code}`)
		task.wait(1)
	end
	robot.blink("all", { count = 1 })
	robot.turn(math.pi / 2) -- radians, to the left
end
