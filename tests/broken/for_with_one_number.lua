-- A loop without its first number.
-- expect: check 4: a `for` needs two numbers
-- help: write for count = 1, 3 do
for count = 3 do
	print(count)
end
