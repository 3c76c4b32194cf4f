-- right
local easy = require("@spykee/easy")

local function signal(side)
	easy.light(side, "on")
	easy.wait()
	easy.light(side, "off")
end

signal("left")
signal("right")
