-- A call without its brackets.
-- expect: check 3: `robot.stop` alone does nothing
robot.stop
