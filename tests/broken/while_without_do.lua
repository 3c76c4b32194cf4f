-- while without do.
-- expect: check 3: `while` needs `do` after it
while not robot.docked()
	task.wait(1)
end
