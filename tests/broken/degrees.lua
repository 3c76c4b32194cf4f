-- Degrees where radians are wanted.
-- expect: check 3: robot.turn takes radians: 90 are 14 turns
robot.turn(90)
