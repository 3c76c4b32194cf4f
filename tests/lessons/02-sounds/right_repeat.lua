-- right
local easy = require("@spykee/easy")
local left = 3
repeat
	easy.sound("bip_2")
	easy.wait()
	left = left - 1
until left == 0
easy.sound("laugh")
