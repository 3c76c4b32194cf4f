-- wrong: The left light never went on
local easy = require("@spykee/easy")
print("left", "on")
easy.wait(1)
print("left", "off")
print("right", "on")
easy.wait(1)
print("right", "off")
