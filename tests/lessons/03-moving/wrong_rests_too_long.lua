-- wrong: It rested for 3.|It rested for 2.9
local easy = require("@spykee/easy")
easy.forward(2)
easy.wait(3)
easy.back(2)
