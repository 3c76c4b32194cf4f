-- A call with two results as a condition.
-- expect: check 3: several results cannot be set here
if ok, code = robot.dock() then
	print("home")
end
