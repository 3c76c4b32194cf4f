-- right
local easy = require("@spykee/easy")
while true do
	easy.leave_home()
	local leg = 1
	while leg <= 3 do
		easy.drive(40)
		local frame = robot.wait_frame(2)
		if frame then
			frame:save("place" .. leg .. ".jpg")
		end
		easy.left(120)
		leg = leg + 1
	end
	easy.go_home()
	while easy.battery() < 60 do
		easy.wait(10)
	end
end
