-- A text of several words without quotes.
-- expect: check 4: a comma is missing before `I`
-- help: if this is a text, write it in quotes
print(Hello I am here)
