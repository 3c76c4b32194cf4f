-- A text without its end.
-- expect: check 3: this string has no closing quote
print("hello)
