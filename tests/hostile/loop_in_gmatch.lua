-- An iterator of string.gmatch that backtracks forever.
-- expect: cpu
for _ in ("a"):rep(2e5):gmatch(".-.-.-.-b") do
end
