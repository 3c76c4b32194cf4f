-- wrong: The laugh came at the same moment as the last beep
local easy = require("@spykee/easy")
for beep = 1, 2 do
	easy.sound("bip_2")
	easy.wait(1)
end
easy.sound("bip_2")
easy.sound("laugh")
