-- wrong: faces the other way
local easy = require("@spykee/easy")
easy.forward(2)
easy.wait(1)
easy.left(180)
easy.forward(2)
