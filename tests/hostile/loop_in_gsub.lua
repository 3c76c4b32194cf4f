-- string.gsub with a function that never returns.
-- expect: cpu
while true do
	pcall(string.gsub, "abc", "%w", function()
		while true do
		end
	end)
end
