-- wrong: centimetres from where it began
local easy = require("@spykee/easy")
easy.forward(2)
easy.wait(1)
easy.back(1)
