-- wrong: When the left light went on, the right one was on too|When the right light went on, the left one was on too
local easy = require("@spykee/easy")
local function signal(side)
	easy.light(side, "on")
	easy.wait(1)
	easy.light(side, "off")
end
task.spawn(signal, "left")
task.spawn(signal, "right")
