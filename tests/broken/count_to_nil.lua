-- A count to nil.
-- expect: run 4: a `for` ends with a number, but `goals.rounds` is nil here
local goals = {}
for round = 1, goals.rounds do
	print(round)
end
