-- spykee lesson 2: sounds
-- A doorbell: three beeps, one per second, and a laugh after the last one.

local easy = require("@spykee/easy")

for beep = 1, 3 do
	easy.sound("bip_2")
	easy.wait(1)
end
easy.sound("laugh")
