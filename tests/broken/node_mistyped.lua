-- A function that the module does not have.
-- expect: check 4: bt.selector does not exist
local bt = require("@spykee/bt")
bt.run(bt.selector(robot.docked))
