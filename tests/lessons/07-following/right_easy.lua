-- right
local easy = require("@spykee/easy")
local size = 0
while size < 8 do
	local ball = easy.see("red")
	if ball == nil then
		easy.left(20)
	elseif ball.where == "left" then
		easy.left(8)
	elseif ball.where == "right" then
		easy.right(8)
	else
		easy.drive(8)
	end
	size = if ball then ball.size else 0
end
