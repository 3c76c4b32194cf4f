-- spykee lesson 1: lights
-- A turn signal: left for a second, right for a second, then all dark.

robot.led("left", true)
task.wait(1)
robot.led("left", false)

robot.led("right", true)
task.wait(1)
robot.led("right", false)
