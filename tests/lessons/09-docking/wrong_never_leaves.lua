-- wrong: It does not leave its station
local ok = robot.dock()
robot.play(if ok then "bip_2" else "alarm")
