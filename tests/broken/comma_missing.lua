-- A comma between two arguments.
-- expect: check 3: this '(' is never closed
robot.move(50 50)
