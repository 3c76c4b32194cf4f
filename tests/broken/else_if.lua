-- elseif in two words.
-- expect: check 6: `else if` begins a second if, which needs an end of its own
local level = 5
if level > 50 then
	print("much")
else if level > 20 then
	print("some")
else
	print("little")
end
