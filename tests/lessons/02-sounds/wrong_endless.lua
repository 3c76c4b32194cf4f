-- wrong: The script does not end
local easy = require("@spykee/easy")
while true do
	for beep = 1, 3 do
		easy.sound("bip_2")
		easy.wait(1)
	end
	easy.sound("laugh")
	easy.wait(1)
end
