-- wrong: The right light never went on
local easy = require("@spykee/easy")
easy.light("left", "on")
easy.wait(1)
easy.light("left", "off")
easy.light("flash", "on")
easy.wait(1)
easy.light("flash", "off")
