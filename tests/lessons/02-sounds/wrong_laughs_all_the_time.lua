-- wrong: It laughed more than once
local easy = require("@spykee/easy")
for beep = 1, 3 do
	easy.sound("bip_2")
	easy.wait(1)
end
for laugh = 1, 2 do
	easy.sound("laugh")
	easy.wait(2)
end
