-- Recursion through C functions: gsub, sort, pcall, coroutines.
-- expect: error memory cpu
local function through_gsub()
	return (("x"):gsub("x", through_gsub))
end
local function through_sort()
	table.sort({ 1, 2, 3 }, through_sort)
end
local function through_coroutine()
	return coroutine.wrap(through_coroutine)()
end
local function through_index(t, key)
	return t[key]
end
print(pcall(through_gsub))
print(pcall(through_sort))
print(pcall(through_coroutine))
local loop = setmetatable({}, { __index = through_index })
return loop.x
