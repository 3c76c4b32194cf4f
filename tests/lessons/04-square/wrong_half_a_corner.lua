-- wrong: It never reached the second corner
local easy = require("@spykee/easy")
for side = 1, 4 do
	easy.drive(40)
	easy.left(45)
end
