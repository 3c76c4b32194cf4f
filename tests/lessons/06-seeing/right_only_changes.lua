-- right
local now = "none"

local function show(side)
	if side == now then
		return
	end
	now = side
	robot.led("left", side == "left")
	robot.led("right", side == "right")
end

task.spawn(function()
	while true do
		local frame = robot.wait_frame(2)
		if frame then
			local ball = frame:find_blobs("red", { pixels_threshold = 30 })[1]
			if not ball then
				show("none")
			elseif ball.bearing >= 0 then
				show("left")
			else
				show("right")
			end
		end
		task.wait(0.1)
	end
end)
