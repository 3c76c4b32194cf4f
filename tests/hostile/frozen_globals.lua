-- Tries to change the libraries that all code uses; each attempt must fail.
-- expect: done
local tables = { string, table, math, coroutine, bit32, buffer, utf8, vector, robot, task, script, log }
for _, library in tables do
	for _, change in {
		function() library.move = print end,
		function() rawset(library, "move", print) end,
		function() setmetatable(library, {}) end,
		function() table.insert(library, print) end,
		function() table.clear(library) end,
		function() table.move({ 1 }, 1, 1, 1, library) end,
	} do
		if pcall(change) then
			error("a library was changed")
		end
	end
end
if pcall(function() getmetatable("").__index = {} end) then
	error("the strings' metatable was changed")
end
for _, change in {
	function() setmetatable(_G, {}) end,
	function() getmetatable(_G).__index = print end,
} do
	if pcall(change) then
		error("the globals' metatable was changed")
	end
end
