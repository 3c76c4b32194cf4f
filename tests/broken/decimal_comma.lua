-- A comma for the decimal point.
-- expect: check 5: easy.forward for 0 seconds
-- help: decimals come after a point: 0.5
local easy = require("@spykee/easy")
easy.forward(0,5)
