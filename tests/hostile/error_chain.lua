-- Errors raised, caught and raised again, through runtime functions with callbacks.
-- expect: error cpu memory
local function deeper(n)
	local ok, text = pcall(task.all, function()
		if n == 0 then
			robot.move("x", "y")
		end
		deeper(n - 1)
	end)
	if not ok then
		error(text)
	end
end
deeper(80000)
