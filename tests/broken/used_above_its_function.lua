-- A function used above its line.
-- expect: check 3: 'greet' is not known here
greet()
local function greet()
	print("hello")
end
greet()
