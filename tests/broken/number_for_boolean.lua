-- On is true, not 1.
-- expect: check 3: robot.led: on must be true or false, got 1
robot.led("left", 1)
