-- wrong: It drives backwards first
local easy = require("@spykee/easy")
easy.back(2)
easy.wait(1)
easy.forward(2)
