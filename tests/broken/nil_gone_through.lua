-- A loop through nil.
-- expect: run 4: `seen.balls` is nil here, so nothing can be gone through
local seen = {}
for _, ball in seen.balls do
	print(ball)
end
