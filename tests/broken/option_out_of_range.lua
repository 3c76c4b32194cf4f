-- An option with too large a number.
-- expect: check 3: robot.dock: retries must be between 0 and 20, got 50
robot.dock({ retries = 50 })
