-- wrong: There should be three beeps, but there were 2
local easy = require("@spykee/easy")
for beep = 1, 2 do
	easy.sound("bip_2")
	easy.wait(1)
end
easy.sound("laugh")
