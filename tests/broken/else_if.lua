-- elseif in two words.
-- expect: check 6: `else if` begins a second if, which needs its own end
local level = 5
if level > 50 then
	print("much")
else if level > 20 then
	print("some")
else
	print("little")
end
