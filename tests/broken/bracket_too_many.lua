-- A bracket that closes nothing.
-- expect: check 3: this ')' closes nothing
print("hello"))
