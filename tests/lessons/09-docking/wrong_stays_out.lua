-- wrong: It does not come home
robot.undock()
robot.turn(math.rad(180))
robot.forward(0.5)
robot.play("bip_2")
