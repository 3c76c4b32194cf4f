-- Requires more modules than are permitted.
-- expect: done
for number = 1, 2000 do
	pcall(require, "./nothing" .. number)
end
for _ = 1, 20 do
	task.spawn(function()
		for number = 1, 100 do
			pcall(require, "./nobody" .. number)
		end
	end)
end
