-- wrong: There should be three beeps, but there was 1
local easy = require("@spykee/easy")
for beep = 1, 3 do
	easy.sound("bip_2")
end
easy.wait(1)
easy.sound("laugh")
