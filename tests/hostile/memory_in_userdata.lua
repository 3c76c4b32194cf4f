-- Keeps hundreds of thousands of task objects.
-- expect: memory cpu error
local keep = {}
while true do
	local one = task.spawn(function() end)
	one:cancel()
	keep[#keep + 1] = one
	if #keep % 200 == 0 then
		task.wait()
	end
	if #keep > 2000 then
		error("enough")
	end
end
