-- wrong: centimetres from where it started
local easy = require("@spykee/easy")
easy.forward(2)
easy.wait(1)
easy.forward(2)
