-- wrong: It drove away for 1.
local easy = require("@spykee/easy")
easy.forward()
easy.wait(1)
easy.back()
