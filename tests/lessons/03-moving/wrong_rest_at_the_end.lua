-- wrong: without a rest|It rested for 0.
local easy = require("@spykee/easy")
easy.forward(2)
easy.back(2)
easy.wait(1)
