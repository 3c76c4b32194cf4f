-- wrong: There was no beep, or only for a moment
local easy = require("@spykee/easy")
for beep = 1, 3 do
	easy.sound("bip_2")
end
easy.sound("laugh")
