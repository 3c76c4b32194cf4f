-- An option key that does not exist.
-- expect: check 3: robot.dock: unknown option 'time_out'; did you mean 'timeout'?
robot.dock({ time_out = 60 })
