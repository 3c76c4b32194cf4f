-- A light is on or off.
-- expect: check 3: robot.led: takes 2 arguments, got 3
robot.led("left", true, 2)
