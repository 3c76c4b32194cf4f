-- The length of nil.
-- expect: run 5: `balls` is nil here, so it has no length
local seen = {}
local function count(balls)
	return #balls
end
print(count(seen.balls))
