-- var of JavaScript.
-- expect: check 3: 'var' is not a word of this language
var speed = 5
print(speed)
