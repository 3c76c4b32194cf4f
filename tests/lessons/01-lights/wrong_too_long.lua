-- wrong: The left light was on for 3.
local easy = require("@spykee/easy")
easy.light("left", "on")
easy.wait(3)
easy.light("left", "off")
easy.light("right", "on")
easy.wait(3)
easy.light("right", "off")
