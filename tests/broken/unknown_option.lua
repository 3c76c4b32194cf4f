-- An option key that does not exist.
-- expect: check 3: robot.dock: unknown option 'retry'; did you mean 'retries'?
robot.dock({ retry = 3 })
