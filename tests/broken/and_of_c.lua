-- && of C.
-- expect: check 4: '&&' is not known here
local a, b = true, false
if a && b then
	print("both")
end
