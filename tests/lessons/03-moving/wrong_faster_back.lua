-- wrong: centimetres from where it started
local easy = require("@spykee/easy")
easy.forward(2, 30)
easy.wait(1)
easy.back(2, 80)
