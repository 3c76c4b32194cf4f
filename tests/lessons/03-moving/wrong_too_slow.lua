-- wrong: not even 15 centimetres
local easy = require("@spykee/easy")
easy.forward(2, 10)
easy.wait(1)
easy.back(2, 10)
