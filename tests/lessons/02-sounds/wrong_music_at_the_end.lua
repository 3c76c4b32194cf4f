-- wrong: it should be "laugh"
local easy = require("@spykee/easy")
for beep = 1, 3 do
	easy.sound("bip_2")
	easy.wait(1)
end
easy.sound("laugh")
easy.wait(2)
easy.sound("alarm")
