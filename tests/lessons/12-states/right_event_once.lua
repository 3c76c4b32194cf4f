-- right
local function sleep_until_noise() end

local function search_and_laugh()
	robot.led("flash", true)
	local found = task.timeout(30, function()
		robot.drive(0, 0.6)
		while true do
			local frame = robot.wait_frame(1)
			if frame and frame:find_blobs("red", { pixels_threshold = 40 })[1] then
				return true
			end
		end
	end)
	robot.stop()
	robot.led("flash", false)
	if found then
		robot.play("laugh")
		task.wait(4)
	end
	sleep_until_noise()
end

function sleep_until_noise()
	robot.once("noise", search_and_laugh)
end

sleep_until_noise()
