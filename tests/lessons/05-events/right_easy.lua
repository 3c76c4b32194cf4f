-- right
local easy = require("@spykee/easy")
robot.on("noise", function()
	easy.light("on")
	easy.left(360)
	easy.light("off")
end)
