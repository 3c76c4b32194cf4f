-- wrong: centimetres from where it started
local easy = require("@spykee/easy")
for side = 0, 4 do
	easy.drive(40)
	easy.left(90)
end
