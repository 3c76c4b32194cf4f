-- // of C.
-- expect: check 3: this is not a comment here
// says hello
print("hello")
