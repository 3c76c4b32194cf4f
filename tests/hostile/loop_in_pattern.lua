-- A pattern that backtracks forever.
-- expect: cpu
while true do
	pcall(string.find, ("a"):rep(1e5), ("a*"):rep(50) .. "b")
end
