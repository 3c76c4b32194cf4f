-- A name for a text.
-- expect: check 3: unknown name 'laugh'
robot.play(laugh)
