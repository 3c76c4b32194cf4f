-- Buffers: first one too large, then many.
-- expect: memory
local keep = {}
while true do
	keep[#keep + 1] = buffer.create(1e6)
end
