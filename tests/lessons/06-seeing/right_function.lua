-- right
local function lights(left, right)
	robot.led("left", left)
	robot.led("right", right)
end

robot.on("frame", function(frame)
	local balls = frame:find_blobs("red")
	if #balls == 0 then
		lights(false, false)
	elseif balls[1].bearing > 0 then
		lights(true, false)
	else
		lights(false, true)
	end
end)
