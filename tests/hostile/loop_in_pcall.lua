-- An endless loop that catches the error that ends it, and drives on.
-- expect: cpu
while true do
	pcall(function()
		while true do
		end
	end)
	pcall(robot.move, 90, 90)
end
