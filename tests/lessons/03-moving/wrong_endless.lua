-- wrong: The script does not end
local easy = require("@spykee/easy")
while true do
	easy.forward(2)
	easy.wait(1)
	easy.back(2)
	easy.wait(1)
end
