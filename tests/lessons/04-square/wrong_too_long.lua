-- wrong: The first side is longer than 40 centimetres|The first side is far too long
local easy = require("@spykee/easy")
for side = 1, 4 do
	easy.drive(80)
	easy.left(90)
end
