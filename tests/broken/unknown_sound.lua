-- Names keep to small letters.
-- expect: check 3: robot.play: unknown sound 'Alarm'; did you mean 'alarm'?
robot.play("Alarm")
