-- Library calls whose time grows with their arguments, in C.
-- expect: cpu memory
local text = ("1"):rep(5e5)
local bytes = buffer.create(5e5)
while true do
	pcall(tonumber, text)
	pcall(tonumber, text, 36)
	pcall(utf8.len, text)
	pcall(string.reverse, text)
	pcall(string.upper, text)
	pcall(buffer.fill, bytes, 0, 7)
	pcall(table.concat, table.create(1000, "x"), text:sub(1, 100))
end
