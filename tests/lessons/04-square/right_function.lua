-- right
local easy = require("@spykee/easy")

local function polygon(corners, length)
	for corner = 1, corners do
		easy.drive(length)
		easy.left(360 / corners)
	end
end

polygon(4, 40)
