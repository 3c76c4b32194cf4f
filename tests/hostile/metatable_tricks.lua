-- Looks for the metatables of the runtime's objects, and for their contents.
-- expect: done
local one = task.spawn(task.wait, 1)
local other = robot.on("docked", function() end)
for _, object in { one, other } do
	local ok, meta = pcall(getmetatable, object)
	if ok and type(meta) == "table" then
		for _, name in { "__index", "__gc", "__type", "__metatable", "evil" } do
			if pcall(function() meta[name] = print end) then
				error("a metatable was changed")
			end
		end
	end
	for _, name in { "__index", "__gc", "__metatable", "cancel", "off" } do
		pcall(function() object[name] = print end)
		local _ = pcall(function() return object[name] end)
	end
	pcall(setmetatable, object, {})
	pcall(rawset, object, "x", 1)
	pcall(rawget, object, "x")
	pcall(next, object)
end
-- Methods on the wrong objects.
pcall(one.cancel, other)
pcall(other.off, one)
pcall(one.cancel, setmetatable({}, {}))
pcall(one.join, one, 0 / 0)
pcall(one.join, one, -1)
one:cancel()
other:off()
