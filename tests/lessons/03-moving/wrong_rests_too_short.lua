-- wrong: It rested for 0.|without a rest
local easy = require("@spykee/easy")
easy.forward(2)
easy.wait(0.1)
easy.back(2)
