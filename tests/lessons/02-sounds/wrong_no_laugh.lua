-- wrong: The last sound was "bip_2"
local easy = require("@spykee/easy")
for beep = 1, 3 do
	easy.sound("bip_2")
	easy.wait(1)
end
