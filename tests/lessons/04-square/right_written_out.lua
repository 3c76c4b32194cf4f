-- right
local easy = require("@spykee/easy")
easy.drive(40)
easy.left()
easy.drive(40)
easy.left()
easy.drive(40)
easy.left()
easy.drive(40)
