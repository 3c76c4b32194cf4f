-- A loop without its condition.
-- expect: check 3: the `repeat` that begins here has no `until`: it is missing at the end of the file
repeat
	task.wait(1)
