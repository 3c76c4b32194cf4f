-- right
local easy = require("@spykee/easy")
easy.leave_home()
easy.forward(4)
local home = easy.go_home()
if not home then
	easy.sound("alarm")
	return
end
easy.sound("bip_2")
