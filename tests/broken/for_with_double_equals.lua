-- A loop whose counter is compared.
-- expect: check 4: the counter of a `for` is set with a single =
-- help: write for count = 1, 3 do
for count == 1, 3 do
	print(count)
end
