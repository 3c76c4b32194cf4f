-- def of Python.
-- expect: check 3: 'def' is not a word of this language
def greet():
	print("hello")
greet()
