-- Keeps error objects that hold each other.
-- expect: memory
local last = {}
while true do
	local _, caught = pcall(error, { last, ("x"):rep(8000) .. tostring(last) })
	last = caught
end
