-- # of Python.
-- expect: check 3: this is no comment here
# says hello
print("hello")
