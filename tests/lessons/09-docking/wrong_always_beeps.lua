-- wrong: It could not get home, but there was a beep
robot.undock()
robot.turn(math.rad(180))
robot.forward(0.5)
robot.dock()
robot.play("bip_2")
