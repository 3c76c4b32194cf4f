-- A loop through nil.
-- expect: run 4: `seen.balls` is nil here, so a loop cannot go through it
local seen = {}
for _, ball in seen.balls do
	print(ball)
end
