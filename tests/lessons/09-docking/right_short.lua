-- right
robot.undock()
robot.turn(math.rad(180))
robot.forward(0.5)
robot.play(if robot.dock() then "bip_2" else "alarm")
