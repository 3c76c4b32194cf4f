-- local function with an equals sign.
-- expect: check 3: expected `(` here, found `=`
local function greet = 5
