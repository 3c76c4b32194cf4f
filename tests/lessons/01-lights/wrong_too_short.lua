-- wrong: The left light was on for 0.
local easy = require("@spykee/easy")
easy.light("left", "on")
easy.wait(0.1)
easy.light("left", "off")
easy.light("right", "on")
easy.wait(0.1)
easy.light("right", "off")
