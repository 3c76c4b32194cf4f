-- wrong: At the second noise its lights did not go on
robot.wait_for("noise")
robot.led("all", true)
robot.turn(math.rad(360))
robot.led("all", false)
