-- Stores invalid values: the store itself, functions, NaN, too deep, too many, with metatables.
-- expect: done
local itself = {}
itself.itself = itself
local shared = {}
for _ = 1, 7 do
	shared = { shared, shared, shared, shared, shared, shared, shared, shared }
end
local deep = {}
for _ = 1, 50000 do
	deep = { deep }
end
local evil = { __index = error, __len = error, __iter = error, __tostring = error, __newindex = error }
local many = table.create(1e5, 1)
local values = {
	itself, shared, deep, many, { [0 / 1] = 1 }, { [true] = 1 }, { [itself] = 1 }, { 1, nil, 3 }, { 0 / 0 }, 0 / 0, math.huge,
	print, coroutine.create(print), robot, "\xff", { ["\xff"] = 1 }, vector.create(1, 2, 3), buffer.create(1e6),
	("\1"):rep(1e6),
}
for at, value in values do
	if pcall(store.set, "value", value) then
		error(`value {at} was kept`)
	end
	task.wait() -- all of them at once are too long for the budget of a busy machine
end
store.set("fine", setmetatable({ 1, 2 }, evil))
assert(#store.get("fine") == 2)
for _, key in { "", "\xff", 1, {}, true } do
	assert(not pcall(store.set, key, 1))
end
