-- wrong: The left light went on, but was not off again
local easy = require("@spykee/easy")
easy.light("left", "off")
easy.wait(1)
easy.light("left", "on")
easy.light("right", "off")
easy.wait(1)
easy.light("right", "on")
