-- wrong: It never reached the fourth corner
local easy = require("@spykee/easy")
for side = 1, 3 do
	easy.drive(40)
	easy.left(90)
end
