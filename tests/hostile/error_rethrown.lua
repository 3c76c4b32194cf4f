-- One error raised again a hundred thousand times; each time its position is prepended.
-- expect: error cpu memory
local _, text = pcall(robot.move, "x")
for _ = 1, 100000 do
	_, text = pcall(error, tostring(text), 1)
	_, text = pcall(function()
		error(text)
	end)
end
error(text)
