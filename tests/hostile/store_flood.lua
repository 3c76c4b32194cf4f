-- Fills its store again and again, with huge and with many values, faster than a disk can write.
-- expect: done
local refused = 0
for round = 1, 40 do
	for number = 1, 20 do
		local ok = pcall(store.set, `key{number}-{round % 3}`, ("x"):rep(60000))
		refused += if ok then 0 else 1
	end
	for number = 1, 200 do
		pcall(store.set, `small{number}`, round)
	end
	task.wait(0.01)
end
assert(refused > 0)
for _, key in store.keys() do
	store.delete(key)
end
pcall(store.set, ("k"):rep(1e6), 1)
pcall(store.get, ("k"):rep(1e6))
