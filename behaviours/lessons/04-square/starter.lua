-- spykee lesson 4: a square
-- A square with sides of 40 centimetres, to the left, back to where it started.
-- Here are one side and one corner.

local easy = require("@spykee/easy")

easy.drive(40)
easy.left(90)
