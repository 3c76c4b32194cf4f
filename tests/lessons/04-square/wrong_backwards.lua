-- wrong: It has not driven the first side
local easy = require("@spykee/easy")
for side = 1, 4 do
	easy.drive(-40)
	easy.left(90)
end
