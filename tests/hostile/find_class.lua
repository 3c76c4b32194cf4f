-- A character class of a megabyte, matched in C.
-- expect: error
local text = ("a"):rep(1e6)
text:find("[" .. ("a"):rep(1e6) .. "b]*x")
