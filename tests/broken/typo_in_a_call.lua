-- A letter swapped in a call.
-- expect: check 3: robot.moev does not exist; did you mean 'move'?
robot.moev(50, 50)
