-- Radians where degrees are wanted.
-- expect: check 4: easy.left takes degrees, not radians
local easy = require("@spykee/easy")
easy.left(math.rad(90))
