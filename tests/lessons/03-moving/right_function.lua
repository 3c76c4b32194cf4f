-- right
local easy = require("@spykee/easy")
local speed = 60

local function there()
	easy.forward(2, speed)
end

local function back()
	easy.back(2, speed)
end

there()
easy.wait(1)
back()
easy.stop()
