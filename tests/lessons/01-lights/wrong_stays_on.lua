-- wrong: At the end the right light is still on
local easy = require("@spykee/easy")
easy.light("left", "on")
easy.wait(1)
easy.light("left", "off")
easy.light("right", "on")
easy.wait(1)
