-- right
local easy = require("@spykee/easy")
local round = 1
while round <= 2 do
	local side = "left"
	if round == 2 then
		side = "right"
	end
	easy.light(side, "on")
	easy.wait(1)
	easy.light("all", "off")
	round = round + 1
end
