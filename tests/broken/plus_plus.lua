-- ++ of other languages.
-- expect: check 4: there is no ++
local count = 0
count++
print(count)
