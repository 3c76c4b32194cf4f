-- wrong: It laughed more than once
local easy = require("@spykee/easy")
for beep = 1, 3 do
	easy.sound("bip_2")
	easy.wait(1)
	easy.sound("laugh")
	easy.wait(0.1)
end
