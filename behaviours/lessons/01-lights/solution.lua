-- spykee lesson 1: lights
-- A turn signal: left for a second, right for a second, then all lights off.

local easy = require("@spykee/easy")

easy.light("left", "on")
easy.wait(1)
easy.light("left", "off")

easy.light("right", "on")
easy.wait(1)
easy.light("right", "off")
