-- "Less or equal" the wrong way round.
-- expect: check 4: '=<' is not known here
local power = 50
while power =< 60 do
	power += 1
end
