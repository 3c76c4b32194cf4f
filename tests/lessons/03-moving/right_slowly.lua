-- right
local easy = require("@spykee/easy")
easy.forward(2, 30)
easy.wait()
easy.back(2, 30)
