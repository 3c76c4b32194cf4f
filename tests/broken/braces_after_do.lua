-- A block in braces, after do.
-- expect: check 4: '{' does not begin a block
-- help: a block needs no braces
do {
	print(1)
}
