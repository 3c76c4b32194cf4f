-- The first of a list that is empty.
-- expect: run 6: `frame:find_blobs("red")[1]` is nil here, so `frame:find_blobs("red")[1].cx` cannot be read
robot.stream("video", true)
local frame = robot.wait_frame(5)
if frame then
	print(frame:find_blobs("red")[1].cx)
end
