-- right
local easy = require("@spykee/easy")
while true do
	robot.wait_for("noise")
	easy.light("flash", "on")
	local began = task.now()
	local ball = nil
	while ball == nil and task.now() - began < 30 do
		easy.left(15)
		ball = easy.see("red")
	end
	easy.light("flash", "off")
	if ball ~= nil then
		easy.sound("laugh")
		easy.wait(4)
	end
end
