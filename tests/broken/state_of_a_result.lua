-- A call in place of a function, in a table.
-- expect: check 4: `enter` stays nil: robot.led returns nothing
local fsm = require("@spykee/fsm")
local awake = { enter = robot.led("flash", true), timeout = { 5, "awake" } }
fsm.new({ initial = "awake", states = { awake = awake } }):run()
