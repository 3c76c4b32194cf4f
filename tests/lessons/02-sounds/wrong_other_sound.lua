-- wrong: There was no beep
local easy = require("@spykee/easy")
for beep = 1, 3 do
	easy.sound("laser")
	easy.wait(1)
end
easy.sound("laugh")
