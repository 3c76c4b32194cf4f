-- A text without its end.
-- expect: check 3: this text has no closing quote
print("hello)
