-- right
local easy = require("@spykee/easy")
local steps = { "side", "corner", "side", "corner", "side", "corner", "side", "corner" }
for _, step in steps do
	if step == "side" then
		easy.drive(40)
	else
		easy.left(90)
	end
end
