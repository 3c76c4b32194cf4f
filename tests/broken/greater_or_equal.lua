-- "Greater or equal" the wrong way round.
-- expect: check 4: '=>' is not known here
local power = 50
if power => 40 then
	print("fast")
end
