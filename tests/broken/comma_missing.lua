-- A comma between two arguments.
-- expect: check 3: a comma is missing before `50`
robot.move(50 50)
