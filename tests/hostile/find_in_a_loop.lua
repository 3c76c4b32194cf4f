-- Searches that are just short enough, again and again.
-- expect: cpu
local text, needle = ("a"):rep(4000), ("a"):rep(3990) .. "b"
while true do
	pcall(string.find, text, needle, 1, true)
	pcall(string.find, text, "[" .. needle .. "]*x")
end
