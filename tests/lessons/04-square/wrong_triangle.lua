-- wrong: It never reached the second corner
local easy = require("@spykee/easy")
for side = 1, 3 do
	easy.drive(40)
	easy.left(120)
end
