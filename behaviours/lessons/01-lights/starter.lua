-- spykee lesson 1: lights
-- A turn signal: left for a second, right for a second, then all lights off.
-- Here the left light goes on and stays on. Continue from there.

local easy = require("@spykee/easy")

easy.light("left", "on")
easy.wait(1)
