-- Creates tables endlessly.
-- expect: memory
local keep = {}
while true do
	keep[#keep + 1] = { {}, {}, {} }
end
