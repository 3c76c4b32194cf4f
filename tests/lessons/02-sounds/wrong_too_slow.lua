-- wrong: Beep 2 came 2.
local easy = require("@spykee/easy")
for beep = 1, 3 do
	easy.sound("bip_2")
	easy.wait(2)
end
easy.sound("laugh")
