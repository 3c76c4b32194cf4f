-- Inspects the wrappers around library functions; no assertion here may fail.
-- expect: done
local list = { 3, 1, 2 }
table.sort(list, function(a, b)
	return a > b
end)
assert(list[1] == 3 and list[3] == 1)
assert(table.find({ "a", "b", "c" }, "c") == 3 and table.find({ 1, 2, 1 }, 1, 2) == 3)
local twin = { __eq = function() return true end }
local one, other = setmetatable({}, twin), setmetatable({}, twin)
assert(table.find({ {}, one }, other) == 2 and table.find({ {}, one }, other, 3) == nil)
local seen = {}
assert(table.foreach({ x = 1 }, function(k, v) seen[k] = v end) == nil and seen.x == 1)
assert(table.foreachi({ 5, 6, 7 }, function(at, v) return if at == 2 then v else nil end) == 6)
assert((("abc"):gsub("%a", string.upper)) == "ABC")
assert((("abc"):gsub("%a", { a = "x" })) == "xbc" and (("abc"):gsub("b", "-")) == "a-c")
for _, call in
	{
		function() table.foreach(nil, print) end,
		function() table.foreach({}, nil) end,
		function() table.foreachi({}, {}) end,
		function() table.find(nil, 1) end,
		function() table.find({}, 1, 0) end,
		function() (table :: any).find = nil end,
	}
do
	local ok, words = pcall(call)
	assert(not ok and type(words) == "string" and not words:find("spykee:", 1, true), words)
end
