-- right
local easy = require("@spykee/easy")
robot.on("noise", function(noise)
	print("I heard something", noise.dbfs)
	easy.light("flash", "on")
	for quarter = 1, 4 do
		easy.left(90)
	end
	easy.light("flash", "off")
end)
