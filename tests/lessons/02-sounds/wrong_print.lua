-- wrong: There was no beep
local easy = require("@spykee/easy")
for beep = 1, 3 do
	print("beep")
	easy.wait(1)
end
print("haha")
