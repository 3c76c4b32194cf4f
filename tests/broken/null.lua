-- null of other languages.
-- expect: check 3: unknown name 'null'
local ball = null
print(ball)
