-- A text of one word without quotes.
-- expect: check 4: unknown name 'hello'
-- help: if this is a text, write it in quotes: "hello"
print(hello)
