-- A list of Python.
-- expect: check 4: a list is not written in round brackets
local f = robot.wait_frame(2)
local b = f and f:find_blobs("red", { roi = ( 0, 200, 320, 40 ) })
