-- Coroutines that wait forever.
-- expect: memory error
local keep = {}
while true do
	local co = coroutine.create(function(...)
		coroutine.yield(...)
	end)
	coroutine.resume(co, 1, 2, 3)
	keep[#keep + 1] = co
end
