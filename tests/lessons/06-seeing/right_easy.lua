-- right
local easy = require("@spykee/easy")
while true do
	local ball = easy.see("red")
	if ball and ball.where == "left" then
		easy.light("left", "on")
		easy.light("right", "off")
	elseif ball and ball.where == "right" then
		easy.light("right", "on")
		easy.light("left", "off")
	else
		easy.light("left", "off")
		easy.light("right", "off")
	end
end
