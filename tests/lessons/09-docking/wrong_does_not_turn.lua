-- wrong: does not drive half a metre away
robot.undock()
robot.forward(0.5)
local ok = robot.dock()
robot.play(if ok then "bip_2" else "alarm")
