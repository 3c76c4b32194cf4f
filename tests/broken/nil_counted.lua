-- A number counted with nil.
-- expect: run 5: `score` is nil here, so it cannot be counted with
local score
local function goal()
	score = score + 1
end
goal()
score = 0
