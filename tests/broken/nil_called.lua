-- A function that is not in the table.
-- expect: run 7: `moves.left` is nil here, so it cannot be called
local moves = {}
function moves.right()
	print("right")
end
moves.left()
