-- Hundreds of thousands of arguments, given to the runtime.
-- expect: error cpu memory
local many = table.create(200000, "x")
while true do
	pcall(task.spawn, print, table.unpack(many, 1, 7000))
	task.spawn(print, table.unpack(many))
end
