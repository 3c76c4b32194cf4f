-- Allocates all memory, catches the error, and allocates again.
-- expect: cpu memory
local keep = {}
while true do
	pcall(function()
		while true do
			keep[#keep + 1] = ("x"):rep(100000) .. #keep
		end
	end)
	pcall(robot.move, 90, 90)
end
