-- Quotes of a word processor.
-- expect: check 3: these are typographic quotes
print(“hello”)
