-- An iterator of string.gmatch that backtracks for ever.
-- expect: cpu
for _ in ("a"):rep(2e5):gmatch(".-.-.-.-b") do
end
