-- wrong: It never reached the third corner
local easy = require("@spykee/easy")
for side = 1, 2 do
	easy.drive(40)
	easy.left(90)
	easy.drive(40)
	easy.right(90)
end
