-- hello: says hello with lights and sounds. It does not drive, so it runs anywhere, even on the
-- charging station. It ends after a few seconds.

local me = robot.info()
print("hello, I am", if me then me.name else "not connected yet")

-- One light after the other, then all together.
for _, light in { "left", "flash", "right" } do
	robot.led(light, true)
	task.wait(0.3)
	robot.led(light, false)
end
robot.play("robot")
robot.blink("all", { on = 0.2, off = 0.2, count = 3 }):join()

local battery = robot.battery()
local level = if battery.percent then `{battery.percent} %` else "an unknown level"
if battery.charging then
	print(`my battery is at {level} and charging`)
else
	print(`my battery is at {level}`)
end

-- A laugh if the battery is above 25 %, otherwise an alarm.
robot.play(if (battery.percent or 100) > 25 then "laugh" else "alarm")
task.wait(1)
