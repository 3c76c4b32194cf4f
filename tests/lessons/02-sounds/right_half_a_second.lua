-- right
local easy = require("@spykee/easy")
easy.sound("bip_2")
easy.wait(1)
easy.sound("bip_2")
easy.wait(1)
easy.sound("bip_2")
easy.wait(0.5)
easy.sound("laugh")
