-- An endless loop that catches its own end and drives on.
-- expect: cpu
while true do
	pcall(function()
		while true do
		end
	end)
	pcall(robot.move, 90, 90)
end
