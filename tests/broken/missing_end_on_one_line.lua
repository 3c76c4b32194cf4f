-- An if without its end, all on one line.
-- expect: check 3: the `if` that begins here has no `end`: it is missing at the end of the file
if robot.docked() then print("home")
