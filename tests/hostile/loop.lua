-- An endless loop.
-- expect: cpu
while true do
end
