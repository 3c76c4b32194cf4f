-- A string that doubles.
-- expect: memory
local text = "x"
while true do
	text ..= text
end
