-- Milliseconds for seconds.
-- expect: check 4: easy.wait takes seconds: 1000 are 17 minutes
local easy = require("@spykee/easy")
easy.wait(1000)
