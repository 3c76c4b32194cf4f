-- != of other languages.
-- expect: check 4: '!=' is not known here
local lost = 1
if lost != 0 then
	print("lost")
end
