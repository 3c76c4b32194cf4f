-- A module without quotes.
-- expect: check 4: the name of a module is written in quotes
-- help: write require("@spykee/easy")
local easy = require(@spykee/easy)
