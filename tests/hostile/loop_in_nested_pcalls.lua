-- pcalls in pcalls, so that an end that is raised only now and then is always caught.
-- expect: cpu
local function again()
	pcall(again)
	while true do
		pcall(again)
	end
end
again()
