-- Modules from outside the folder, by every kind of path.
-- expect: done
local paths = {
	"../secret", "./../secret", "./lib/../../secret", "/etc/passwd", "./../../../../../../etc/passwd", "etc/passwd",
	"./..", "./.", "./", "", ".", "..", "/", "./.hidden", "./x/../../x", "./\\..\\secret", "./x\0", "./\xff\xfe",
	"@spykee", "@spykee/", "@spykee/../bt", "@spykee/BT", "@/etc/passwd", "@self/x", "file:///etc/passwd", "./WITNESS",
	("./x"):rep(100), "./" .. ("x"):rep(1e6), "@spykee/" .. ("x"):rep(1e6), ("../"):rep(1e5) .. "etc/passwd",
}
for _, path in paths do
	local found, what = pcall(require, path)
	if found or #what > 1000 then
		while true do
			robot.move(90, 90) -- Found: the test sees that it never ended.
		end
	end
end
for _, value in { 1, true, {}, print, setmetatable({}, { __tostring = function() return "./x" end }) } do
	assert(not pcall(require, value))
end
