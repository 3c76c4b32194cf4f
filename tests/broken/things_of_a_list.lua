-- One name for the things of a list.
-- expect: check 5: `blob` is 1, 2, 3, ... here
local f = robot.wait_frame(2)
if f then
	for blob in f:find_blobs("red") do
		print(blob)
	end
end
