-- wrong: It drove away for 4.
local easy = require("@spykee/easy")
easy.forward(4)
easy.wait(1)
easy.back(4)
