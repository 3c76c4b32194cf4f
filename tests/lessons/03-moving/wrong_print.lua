-- wrong: The robot does not drive away
local easy = require("@spykee/easy")
print("forward", 2)
easy.wait(1)
print("back", 2)
