-- Declares parameters that are invalid, endlessly long, have metatables, or exist already.
-- expect: error
local evil = { __index = error, __len = error, __iter = error, __tostring = error }
local long = {}
for number = 1, 5000 do
	long["p" .. number] = { default = 1 }
end
local itself = {}
itself.itself = itself
for _, wrong in {
	long, itself, { a = { default = print } }, { a = { default = ("x"):rep(1e6) } }, { a = { default = 0 / 0 } },
	{ [("n"):rep(1e6)] = { default = 1 } }, { a = { default = "x", choices = table.create(1e5, "x") } }, { a = evil },
} do
	assert(not pcall(params.declare, wrong))
end
local values = params.declare(setmetatable({ a = setmetatable({ default = 1 }, evil) }, evil))
assert(values.a == 1)
assert(not pcall(function()
	values.a = 2
end))
params.declare({ a = { default = 1 } })
