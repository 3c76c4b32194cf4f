-- right
local easy = require("@spykee/easy")

local function ring(times)
	if times == 0 then
		return
	end
	easy.sound("bip_2")
	easy.wait(1)
	ring(times - 1)
end

ring(3)
easy.sound("laugh")
