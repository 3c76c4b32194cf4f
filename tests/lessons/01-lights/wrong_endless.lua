-- wrong: The script does not end
local easy = require("@spykee/easy")
while true do
	easy.light("left", "on")
	easy.wait(1)
	easy.light("left", "off")
	easy.light("right", "on")
	easy.wait(1)
	easy.light("right", "off")
end
