-- A light that does not exist.
-- expect: check 3: robot.led: unknown light 'lefft'; did you mean 'left'?
robot.led("lefft", true)
