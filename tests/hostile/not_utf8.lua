-- Bytes that are not UTF-8.
-- expect: refused: not UTF-8
local text = "ÿþÀ€"
robot.move(90, 90)
