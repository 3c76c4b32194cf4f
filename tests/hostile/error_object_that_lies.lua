-- Error objects whose __tostring raises, returns something else than a string, or returns megabytes.
-- expect: error memory
local function object(fn)
	return setmetatable({}, { __tostring = fn, __metatable = "locked" })
end
local fails = object(function()
	error(fails)
end)
local gives_none = object(function()
	return 7
end)
local gives_much = object(function()
	return ("x"):rep(3e6)
end)
for _, one in { fails, gives_none, gives_much } do
	pcall(print, one)
	pcall(log.error, one, { one = one })
	task.spawn(error, one)
end
task.wait(0.05)
error(gives_much)
