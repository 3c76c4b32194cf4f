-- A call that is not closed, in a handler.
-- expect: check 5: this '(' is never closed
-- help: a ')' or a comma is missing
robot.on("battery", function()
	print("low"
end)
