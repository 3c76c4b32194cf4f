-- A text joined with nil.
-- expect: run 4: `names[3]` is nil here, so it cannot be joined to a string
local names = { "Ann", "Bob" }
print("hello " .. names[3])
