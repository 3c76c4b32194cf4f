-- wrong: There should be three beeps, but there were 4
local easy = require("@spykee/easy")
for beep = 0, 3 do
	easy.sound("bip_2")
	easy.wait(1)
end
easy.sound("laugh")
