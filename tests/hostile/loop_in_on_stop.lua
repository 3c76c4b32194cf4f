-- A farewell that never returns; the script itself is done.
-- expect: done
script.on_stop(function()
	while true do
		pcall(function()
			while true do
			end
		end)
	end
end)
