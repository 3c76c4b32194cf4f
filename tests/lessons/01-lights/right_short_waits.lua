-- right
local easy = require("@spykee/easy")
easy.light("all", "off")
easy.light("left")
for tenth = 1, 10 do
	easy.wait(0.1)
end
easy.light("left", false)
easy.wait(0.5)
easy.light("right")
for tenth = 1, 10 do
	easy.wait(0.1)
end
easy.light("right", false)
