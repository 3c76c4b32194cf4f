-- spykee lesson 4: a square
-- A square with sides of 40 centimetres, to the left, back to where it started.

local easy = require("@spykee/easy")

for side = 1, 4 do
	easy.drive(40)
	easy.left(90)
end
