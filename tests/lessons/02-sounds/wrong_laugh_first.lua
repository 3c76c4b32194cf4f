-- wrong: The last sound was "bip_2"
local easy = require("@spykee/easy")
easy.sound("laugh")
easy.wait(1)
for beep = 1, 3 do
	easy.sound("bip_2")
	easy.wait(1)
end
