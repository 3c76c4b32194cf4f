-- right
local easy = require("@spykee/easy")
local sides = 0
while sides < 4 do
	easy.drive(40)
	easy.left(90)
	sides = sides + 1
end
