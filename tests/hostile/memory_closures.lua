-- Functions that hold functions.
-- expect: memory
local last = nil
while true do
	local before = last
	last = function()
		return before
	end
end
