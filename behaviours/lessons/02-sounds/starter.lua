-- spykee lesson 2: sounds
-- A doorbell: three beeps, one per second, and a laugh after the last one.
-- Here the beep and the laugh come at the same moment. There should be three beeps, a second apart.

local easy = require("@spykee/easy")

easy.sound("bip_2")
easy.sound("laugh")
