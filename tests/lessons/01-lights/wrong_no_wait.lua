-- wrong: The left light was on for 0.0 seconds|The left light never went on
local easy = require("@spykee/easy")
easy.light("left", "on")
easy.light("left", "off")
easy.light("right", "on")
easy.light("right", "off")
