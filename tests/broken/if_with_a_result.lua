-- A result that is kept within the test.
-- expect: check 3: a result cannot be set here
if home = robot.dock() then
	robot.play("bip_2")
end
