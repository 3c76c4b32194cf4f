-- wrong: When the left light went on, the right one was on too
local easy = require("@spykee/easy")
easy.light("all", "on")
easy.wait(1)
easy.light("all", "off")
