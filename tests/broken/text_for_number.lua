-- A number in quotes.
-- expect: check 3: robot.move: left must be a number between -100 and 100, got '50'
robot.move("50", 50)
