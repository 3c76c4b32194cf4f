-- True of Python.
-- expect: check 3: unknown name 'True'
robot.led("left", True)
