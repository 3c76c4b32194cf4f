-- A table that contains itself many times: a converter that follows it never ends.
-- expect: done
local t = {}
t.t, t[1], t[t] = t, t, t
for _ = 1, 7 do
	t = { t, t, t, t, t, t, t, t }
end
log.info("itself", { t = t })
pcall(robot.dock, t)
pcall(robot.on, "docked", function() end, t)
