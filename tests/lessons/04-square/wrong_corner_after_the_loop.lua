-- wrong: The first side is longer|turned at no corner|far too long
local easy = require("@spykee/easy")
for side = 1, 4 do
	easy.drive(40)
end
easy.left(90)
