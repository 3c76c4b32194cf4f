-- Keeps every frame.
-- expect: done memory error
local keep = {}
robot.stream("video", true)
for _ = 1, 10 do
	keep[#keep + 1] = robot.wait_frame(0.02)
	for _ = 1, 1000 do
		keep[#keep + 1] = robot.frame()
	end
end
