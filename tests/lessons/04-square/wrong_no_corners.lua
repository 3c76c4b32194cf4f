-- wrong: turned at no corner
local easy = require("@spykee/easy")
easy.drive(40)
easy.drive(40)
