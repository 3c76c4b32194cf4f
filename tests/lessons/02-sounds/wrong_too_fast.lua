-- wrong: Beep 2 came 0.5 seconds after
local easy = require("@spykee/easy")
for beep = 1, 3 do
	easy.sound("bip_2")
	easy.wait(0.5)
end
easy.sound("laugh")
