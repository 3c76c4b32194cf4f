-- wrong: The right light went on first
local easy = require("@spykee/easy")
easy.light("right", "on")
easy.wait(1)
easy.light("right", "off")
easy.light("left", "on")
easy.wait(1)
easy.light("left", "off")
