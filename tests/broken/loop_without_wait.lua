-- A loop that never waits.
-- expect: check 3: this loop never waits: the script would be ended after 0.1 s
while true do
	robot.move(20, 20)
end
