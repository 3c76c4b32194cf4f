-- wrong: It laughed without a beep before
local easy = require("@spykee/easy")
easy.wait(1)
easy.sound("laugh")
