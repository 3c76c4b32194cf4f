-- A number counted with nil.
-- expect: run 5: `score` is nil here, so it cannot be used in arithmetic
local score
local function goal()
	score = score + 1
end
goal()
score = 0
