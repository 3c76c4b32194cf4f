-- wrong: When the right light went on, the left one was on too|The left light was on for 2.
local easy = require("@spykee/easy")
easy.light("left", "on")
easy.wait(1)
easy.light("right", "on")
easy.wait(1)
easy.light("all", "off")
