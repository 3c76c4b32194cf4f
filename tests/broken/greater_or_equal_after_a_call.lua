-- "Greater or equal" the wrong way round, after a call.
-- expect: check 6: '=>' is not known here
-- help: "greater or equal" is written >=
local easy = require("@spykee/easy")
local limit = 40
if easy.battery() => limit then
	print("full")
end
