-- A comma for the decimal point.
-- expect: check 5: easy.forward over 0 metres
-- help: decimals come after a point: 0.5
local easy = require("@spykee/easy")
easy.forward(0,5)
