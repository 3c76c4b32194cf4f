-- A string that is doubled again and again.
-- expect: memory
local text = "x"
while true do
	text ..= text
end
