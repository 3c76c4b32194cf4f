-- Tries to access everything that scripts must not have.
-- expect: done
local names = {
	"io", "os", "debug", "package", "loadstring", "load", "loadfile", "dofile", "getfenv", "setfenv",
	"newproxy", "gcinfo", "jit", "ffi", "rawsetmetatable", "mlua", "__host",
}
for _, name in names do
	local found, value = pcall(function()
		return _G[name]
	end)
	if found and value ~= nil then
		while true do
			robot.move(90, 90) -- Found: the test sees that it never ended.
		end
	end
	if rawget(_G, name) ~= nil then
		error("found " .. name)
	end
end
