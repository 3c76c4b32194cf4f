-- wrong: At the first corner it turned to the right
local easy = require("@spykee/easy")
for side = 1, 4 do
	easy.drive(40)
	easy.right(90)
end
