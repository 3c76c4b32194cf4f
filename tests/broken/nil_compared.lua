-- A number compared with nil.
-- expect: run 4: `goals.left` is nil here, so it cannot be compared with < or >
local goals = { right = 5 }
if goals.left > 3 then
	print("left")
end
