-- Metamethods that never return.
-- expect: cpu
local function forever()
	while true do
	end
end
local trap = setmetatable({}, {
	__index = forever,
	__newindex = forever,
	__add = forever,
	__eq = forever,
	__lt = forever,
	__len = forever,
	__concat = forever,
	__call = forever,
	__iter = forever,
})
while true do
	pcall(function()
		return trap.x
	end)
	pcall(function()
		return trap + 1
	end)
	pcall(function()
		for _ in trap do
		end
	end)
end
