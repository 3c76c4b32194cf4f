-- A semicolon between the numbers of a loop.
-- expect: check 4: these numbers are separated by commas
-- help: write for count = 1, 3 do
for count = 1; 3 do
	print(count)
end
