-- right
local easy = require("@spykee/easy")
for side = 1, 4 do
	easy.drive(20)
	easy.wait(0.5)
	easy.drive(20)
	easy.wait(0.5)
	easy.left(45)
	easy.left(45)
	easy.wait(0.5)
end
