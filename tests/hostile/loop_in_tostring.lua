-- An error object whose __tostring never returns.
-- expect: cpu
local trap = setmetatable({}, {
	__tostring = function()
		while true do
		end
	end,
})
pcall(print, trap)
error(trap)
