-- import of Python.
-- expect: check 3: 'import' is not a word of this language
import robot
robot.stop()
