-- wrong: It drove back without a rest
local easy = require("@spykee/easy")
easy.forward(2)
easy.back(2)
