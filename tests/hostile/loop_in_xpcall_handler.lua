-- An error handler of xpcall that never returns.
-- expect: cpu
while true do
	xpcall(function()
		error("now")
	end, function()
		while true do
		end
	end)
end
