-- A function of a text called with a dot.
-- expect: check 4: upper must be called with a colon: name:upper(...)
local name = "Ada"
print(name.upper())
