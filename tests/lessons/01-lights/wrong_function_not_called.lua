-- wrong: No light ever went on
local easy = require("@spykee/easy")
local function signal(side)
	easy.light(side, "on")
	easy.wait(1)
	easy.light(side, "off")
end
local first = signal
local second = signal
