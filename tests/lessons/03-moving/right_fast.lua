-- right
local easy = require("@spykee/easy")
easy.forward(2, 80)
easy.wait(1)
easy.back(2, 80)
