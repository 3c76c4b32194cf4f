-- wrong: first it has to turn round
robot.undock()
robot.forward(0.5)
local ok = robot.dock()
robot.play(if ok then "bip_2" else "alarm")
