-- Comparisons of megabytes, in C, many for each safepoint.
-- expect: cpu
local a, b = ("a"):rep(1e6) .. "1", ("a"):rep(1e6) .. "2"
while true do
	local _ = a < b, a < b, a < b, a < b, a < b, a < b, a < b, a < b, a < b, a < b, a < b, a < b
end
