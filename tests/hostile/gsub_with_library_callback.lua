-- A replacement in C for each of a million letters.
-- expect: cpu
local text = ("x"):rep(1e6)
while true do
	pcall(string.gsub, text, "x", string.upper)
	pcall(string.gsub, text, "x*", string.reverse)
	pcall(string.gsub, text, ".", setmetatable({}, { __index = rawget }))
end
