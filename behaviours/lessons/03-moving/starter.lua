-- spykee lesson 3: moving
-- There and back: forwards for two seconds, a second of rest, and back to where it started.
-- Here it drives there. And back?

local easy = require("@spykee/easy")

easy.forward(2)
