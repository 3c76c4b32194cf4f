-- string.split with a separator of a megabyte.
-- expect: error
local text = ("a"):rep(2e6)
text:split(text:sub(1, 1e6) .. "b")
