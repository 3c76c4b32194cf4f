-- elseif without then.
-- expect: check 6: `elseif` needs `then` after it
local level = 5
if level > 50 then
	print("much")
elseif level > 20
	print("some")
end
