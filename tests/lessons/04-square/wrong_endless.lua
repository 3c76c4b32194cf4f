-- wrong: It turns round and round
local easy = require("@spykee/easy")
while true do
	easy.drive(40)
	easy.left(90)
end
