-- A list in square brackets.
-- expect: check 4: a value is missing after `=`
-- help: a list is written in braces: { 1, 2, 3 }
local names = []
print(names)
