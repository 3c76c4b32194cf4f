-- wrong: turned at no corner
local easy = require("@spykee/easy")
for side = 1, 2 do
	easy.drive(40)
	easy.drive(-40)
end
