-- A loop without a name.
-- expect: check 3: a `for` needs a name that counts
for 1, 3 do
	print("again")
end
