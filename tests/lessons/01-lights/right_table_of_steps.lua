-- right
local easy = require("@spykee/easy")
local steps = {
	{ "left", "on", 1 },
	{ "left", "off", 0 },
	{ "right", "on", 1 },
	{ "right", "off", 0 },
}
for number = 1, #steps do
	easy.light(steps[number][1], steps[number][2])
	easy.wait(steps[number][3])
end
