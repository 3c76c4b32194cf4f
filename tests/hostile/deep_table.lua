-- A table fifty thousand levels deep, passed to every function that takes a table.
-- expect: error
local deep = {}
for _ = 1, 50000 do
	deep = { deep }
end
print(deep)
log.info("deep", deep)
log.info("deep", { deep = deep })
pcall(robot.blink, "flash", deep)
pcall(robot.on, "docked", function() end, deep)
error(deep)
