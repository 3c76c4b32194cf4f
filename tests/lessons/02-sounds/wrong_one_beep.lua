-- wrong: There should be three beeps, but there was 1
local easy = require("@spykee/easy")
easy.sound("bip_2")
easy.wait(3)
easy.sound("laugh")
