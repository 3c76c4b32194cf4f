-- spykee lesson 3: moving
-- There and back: forwards for two seconds, a second of rest, and back to where it started.

local easy = require("@spykee/easy")

easy.forward(2)
easy.wait(1)
easy.back(2)
