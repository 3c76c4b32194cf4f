-- right
local easy = require("@spykee/easy")
easy.leave_home()
easy.drive(50)
if easy.go_home() then
	easy.sound("bip_2")
else
	easy.sound("alarm")
end
