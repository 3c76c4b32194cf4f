-- spykee lesson 5: listening
-- A robot that wakes up at each noise: lights on, once round, lights off.
-- Here it wakes up at once, and only once. It should wait for a noise.

robot.led("all", true)
robot.turn(math.rad(360))
robot.led("all", false)
