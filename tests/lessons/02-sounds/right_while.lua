-- right
local easy = require("@spykee/easy")
local count = 0
while count < 3 do
	easy.sound("bip_2")
	easy.wait(1)
	count += 1
end
easy.sound("laugh")
