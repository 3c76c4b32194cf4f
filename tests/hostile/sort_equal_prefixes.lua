-- table.sort of long strings that differ only at their end, compared in C.
-- expect: cpu memory
local list, start = {}, ("a"):rep(1000)
for at = 1, 3000 do
	list[at] = start .. at
end
while true do
	table.sort(list)
	table.sort(list, function(a, b)
		return b < a
	end)
end
