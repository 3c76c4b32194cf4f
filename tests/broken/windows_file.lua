-- A typo in a file with a byte order mark and Windows line ends.
-- expect: check 4: robot.moev does not exist; did you mean 'move'?
print("hello")
robot.moev(50, 50)
