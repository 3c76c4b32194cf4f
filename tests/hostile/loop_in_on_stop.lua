-- An on_stop that never returns; the script itself has ended.
-- expect: done
script.on_stop(function()
	while true do
		pcall(function()
			while true do
			end
		end)
	end
end)
